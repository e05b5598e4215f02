"""A network as a policy: it sees what the data set shows, turns as the picture turns, and says actions or tilts."""

import numpy as np
import pytest
import torch
from viewpoint_sets import pictures

from gvp_book.experiments.learned import policy_of
from gvp_lib import NetworkPolicy
from gvp_lib.errors import GvpError
from gvp_lib.learning.checkpoints import TrainedNetwork, save_trained
from gvp_lib.learning.dataset import ViewpointDataset
from gvp_lib.learning.labels import TURNED_ACTIONS, TURNS, turned
from gvp_lib.learning.resnet import ResNet, normalized
from gvp_lib.planning import Action

pytestmark = pytest.mark.usefixtures("tiny")
RNG = np.random.default_rng(0)
PICTURE = np.ascontiguousarray(RNG.integers(0, 256, (8, 8, 3), np.uint8).repeat(32, axis=0).repeat(32, axis=1))  # 256


def trained(target="action", **metadata):
    outputs = {"action": 5, "tilt": 3}[target]
    torch.manual_seed(3)
    network = ResNet("tiny", outputs).eval()
    with torch.no_grad():
        network.fc.weight *= 3  # says something decided
    metadata = {"network": "tiny", "target": target, "size": 32, "crop": 128, "outputs": outputs, **metadata}
    return TrainedNetwork(network, metadata)


def uv(tilt):
    return np.array([tilt.u, tilt.v])


def test_it_says_an_action_with_its_probabilities_or_a_tilt(tmp_path):
    save_trained(tmp_path / "w.safetensors", trained())
    policy = NetworkPolicy(tmp_path / "w.safetensors")
    shares = policy.probabilities(PICTURE)
    assert shares.sum() == pytest.approx(1)
    assert policy(PICTURE) is Action(int(shares.argmax()))
    tilt = NetworkPolicy(trained("tilt"))(PICTURE)
    wider = NetworkPolicy(trained("tilt", scores={"validation_calibration": 1.5}))(PICTURE)
    assert wider.sigma == pytest.approx(1.5 * tilt.sigma)  # by what the validation found
    np.testing.assert_allclose(uv(wider), uv(tilt))


def test_it_sees_of_a_stored_picture_what_the_data_set_shows_of_it(lessons):
    data = ViewpointDataset(lessons, "all", size=32, crop=96)
    policy = NetworkPolicy(trained(crop=96))
    with torch.inference_mode():
        outputs = torch.softmax(policy.trained.network(normalized(data.batch(range(3))[0])), dim=1).numpy()
    for stored, expected in zip(pictures(lessons)[:3], outputs, strict=True):
        whole = np.zeros((480, 640, 3), np.uint8)
        whole[176:304, 256:384] = stored
        np.testing.assert_allclose(policy.probabilities(whole), expected, atol=1e-5)


def test_shown_in_all_turns_it_answers_a_turned_picture_by_the_turned_answer():
    actions, tilts = NetworkPolicy(trained(), tta=8), NetworkPolicy(trained("tilt"), tta=8)
    shares, tilt = actions.probabilities(PICTURE), tilts(PICTURE)
    assert np.ptp(shares) > 0.01
    for number, turn in enumerate(TURNS):
        picture = np.ascontiguousarray(turned(PICTURE, turn))
        np.testing.assert_allclose(actions.probabilities(picture)[TURNED_ACTIONS[number]], shares, atol=1e-5)
        other = tilts(picture)
        np.testing.assert_allclose(uv(other), turn @ uv(tilt), atol=1e-5)
        assert other.sigma == pytest.approx(tilt.sigma, rel=1e-5)
    once = NetworkPolicy(trained())
    assert not np.allclose(once.probabilities(picture)[TURNED_ACTIONS[number]], once.probabilities(PICTURE), atol=1e-3)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: NetworkPolicy(trained(), tta=2), "in 1, 4 or 8 ways; got tta=2"),
        (lambda: NetworkPolicy(trained().network), "the path of a file, or the name of a network .*; got a ResNet"),
        (lambda: NetworkPolicy(trained(), device=None), "None is not available here .*'cpu' is"),
        (lambda: NetworkPolicy(trained(), device="abacus"), "'abacus' is not available here .*'cpu' is"),
        (lambda: NetworkPolicy(trained("tilt")).probabilities(PICTURE), "estimates a tilt"),
        (lambda: NetworkPolicy(trained())(PICTURE / 255), "RGB image is a uint8 array"),
    ],
)
def test_misuse_is_refused_with_what_would_do(call, message):
    with pytest.raises(GvpError, match=message):
        call()


def test_a_device_of_torch_is_one_by_its_name():
    policy, by_name = (
        NetworkPolicy(trained(), device=torch.device("cpu"), tta=np.int64(4)),
        NetworkPolicy(trained(), tta=4),
    )
    np.testing.assert_array_equal(policy.probabilities(PICTURE), by_name.probabilities(PICTURE))
    assert repr(policy) == repr(by_name)


def test_an_experiment_s_policy_is_cached_until_its_file_is_another(tmp_path):
    file, other = tmp_path / "w.safetensors", trained()
    save_trained(file, other)
    first = policy_of(str(file), 1)
    assert policy_of(str(file), 1) is first
    with torch.no_grad():
        other.network.fc.bias += torch.arange(5.0)
    save_trained(file, other)
    assert not np.allclose(policy_of(str(file), 1).probabilities(PICTURE), first.probabilities(PICTURE))


def test_another_device_s_policy_leaves_a_shared_network_where_it_is(monkeypatch):
    monkeypatch.setattr("gvp_lib.learning.policy.find_device", lambda name: name)
    shared = trained()
    first = NetworkPolicy(shared)
    before = first.probabilities(PICTURE)
    other = NetworkPolicy(shared, device="meta")  # a device that is everywhere
    assert next(other._network.parameters()).device.type == "meta"
    np.testing.assert_array_equal(first.probabilities(PICTURE), before)
    assert NetworkPolicy(shared)._network is shared.network


def test_a_tilt_beyond_all_sense_is_the_farthest_that_way():
    wild, bias = trained("tilt"), (-30.0, 70.0)
    with torch.no_grad():
        wild.network.fc.weight.zero_()
        wild.network.fc.bias[:] = torch.tensor([*bias, 0.0])  # times 0.25 rad
    tilt = NetworkPolicy(wild)(PICTURE)
    assert tilt.angle == pytest.approx(np.pi)
    assert tilt.direction == pytest.approx(np.arctan2(bias[1], bias[0]), abs=1e-6)
    assert tilt.step(0.5).rotation.magnitude() == pytest.approx(np.pi)
