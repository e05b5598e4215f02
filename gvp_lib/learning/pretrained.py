def load_weights(network, weights):
    assert weights is None
