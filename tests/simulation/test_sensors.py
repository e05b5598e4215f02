"""What an episode draws from a noise, and what it makes of encoders, pictures and range readings."""

import numpy as np
import pytest

from gvp_lib.errors import InvalidImageError, InvalidParameterError
from gvp_lib.simulation.sensors import EpisodeNoise, Noise, RangeSensor
from gvp_lib.simulation.truth import Truth

REACH = (0.04, 0.4)  # m
SEEDS = range(200)


def episode(seed=0, joints=7, **settings):
    return EpisodeNoise(Noise(**settings), joints, np.random.SeedSequence(seed))


def gray(level=100):
    return np.full((48, 64, 3), level, np.uint8)


def readings(noise):
    return np.array([noise.read(0.2, REACH) for _ in range(4000)])


def test_neither_another_source_of_noise_nor_another_joint_changes_what_a_source_draws():
    encoders = {"joint_offset_sd": 0.01, "repeatability_sd": 0.002, "focal_length": 0.01, "range_bias": 0.005}
    more = {"pixel_sd": 3.0, "distortion": 0.1, "exposure": 0.1, "range_sd": 0.01, "range_spike": 0.5}
    alone, beside, longer = episode(5, 6, **encoders), episode(5, 6, **encoders, **more), episode(5, **encoders, **more)
    # What is used of one stream in between does not advance another.
    beside.expose(gray())
    beside.read(0.2, REACH)
    np.testing.assert_array_equal(alone.joint_offset, beside.joint_offset)
    np.testing.assert_array_equal(alone.joint_offset, longer.joint_offset[:6])
    np.testing.assert_array_equal(alone.landing_error(6), beside.landing_error(6))
    assert (alone.focal_scale, alone.range_bias) == (beside.focal_scale, beside.range_bias)
    assert (beside.gain, beside.focal_scale, beside.distortion) == (longer.gain, longer.focal_scale, longer.distortion)


def test_a_perfect_cell_has_no_noise_at_all():
    noise, image = episode(), gray()
    assert noise.expose(image) is image
    assert noise.read(0.2, REACH) == 0.2
    assert (noise.gain, noise.focal_scale, noise.range_bias, noise.distortion) == (1, 1, 0, 0)
    assert not noise.joint_offset.any()
    assert not noise.landing_error(7).any()


@pytest.mark.parametrize(
    ("setting", "bound", "drawn", "middle"),
    [
        ("exposure", 0.1, "gain", 1),
        ("focal_length", 0.01, "focal_scale", 1),
        ("range_bias", 0.005, "range_bias", 0),
        ("distortion", 0.2, "distortion", 0),
    ],
)
def test_what_is_drawn_for_an_episode_is_uniform_within_its_bound(setting, bound, drawn, middle):
    off = np.array([getattr(episode(seed, **{setting: bound}), drawn) for seed in SEEDS]) - middle
    assert -bound <= off.min() < -0.95 * bound
    assert 0.95 * bound < off.max() <= bound
    assert off.std() == pytest.approx(bound / np.sqrt(3), rel=0.1)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"pixel_sd": -1}, r"pixel_sd is a magnitude: finite and not negative; got -1"),
        ({"range_bias": np.nan}, r"range_bias is a magnitude: finite.*got nan"),
        ({"range_sd": np.inf}, r"range_sd is a magnitude: finite.*got inf"),
        ({"joint_offset_sd": 5}, r"joint_offset_sd is in radians.*np\.radians.*got 5"),
        ({"exposure": 1}, r"exposure is relative, 0\.1 for ten.*got 1$"),
        ({"distortion": 0.51}, r"distortion is the coefficient k1 .* 0 to 0\.5.*got 0\.51"),
        ({"range_dropout": 0.8, "range_spike": 0.4}, r"probabilities of exclusive events.*; got 0\.8 \+ 0\.4 > 1"),
    ],
)
def test_a_noise_that_cannot_be_is_refused_with_what_it_is(given, text):
    with pytest.raises(InvalidParameterError, match=text):
        Noise(**given)


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: episode(joints=2**63), "an arm has 0 to 1000 joints; got 9223372036854775808"),
        (lambda: episode().landing_error(-1), "an arm has 0 to 1000 joints; got -1"),
        (lambda: episode().expose(gray() / 255), r"an RGB image is a uint8 array .*float64"),
        (lambda: episode().expose(gray()[..., 0]), "an RGB image is a uint8 array .*gray"),
        (lambda: episode().read(np.nan, REACH), "a distance, 0 or more.*got nan"),
        (lambda: episode().read(0.2, (0.4, np.inf)), r"shortest to its longest.*got 0\.2 and \(0\.4, inf\)"),
    ],
)
def test_what_an_episode_cannot_draw_is_refused_with_what_it_can(call, text):
    with pytest.raises((InvalidParameterError, InvalidImageError), match=text):
        call()


@pytest.mark.parametrize("site", [-1, 99])
def test_a_sensor_or_a_truth_of_what_a_scene_lacks_is_refused(cell_of, site):
    cell = cell_of("baxter")
    for make in (
        lambda: RangeSensor(cell.model, cell.data, site),
        lambda: Truth(cell.data, 10 * site, 0, cell.target_spec.accepted_normal),
        lambda: Truth(cell.data, 1, site, cell.target_spec.accepted_normal),
    ):
        with pytest.raises(InvalidParameterError, match=r"the model has no (site|body|camera) of id -?\d+; it has \d+"):
            make()


def test_encoder_offsets_have_the_spread_they_state_and_stay_for_an_episode():
    offsets = np.array([episode(seed, joint_offset_sd=0.01).joint_offset for seed in SEEDS])
    assert offsets.std() == pytest.approx(0.01, rel=0.05)
    assert abs(offsets.mean()) < 0.001
    noise = episode(repeatability_sd=0.002)
    landings = np.array([noise.landing_error(7) for _ in range(300)])
    assert landings.std() == pytest.approx(0.002, rel=0.1)


def test_exposure_scales_the_picture_and_saturates():
    noise = next(n for n in (episode(seed, exposure=0.1) for seed in SEEDS) if n.gain > 1.05)
    assert np.abs(noise.expose(gray(100)) - 100 * noise.gain).max() <= 0.5
    assert noise.expose(gray(250)).min() == 255


def test_pixel_noise_differs_from_frame_to_frame_of_any_size_and_keeps_the_mean():
    noise = episode(pixel_sd=2.0)
    first, second = (noise.expose(gray()).astype(float) for _ in range(2))
    assert noise.expose(gray().repeat(2, axis=0)).shape == (96, 64, 3)
    assert (first != second).mean() > 0.5
    assert first.mean() == pytest.approx(100, abs=0.2)
    assert first.std() == pytest.approx(2.0, rel=0.1)
    assert abs(np.corrcoef(first[..., 0].ravel(), first[..., 1].ravel())[0, 1]) < 0.1  # channels are independent


def test_pixel_noise_ends_at_black_and_at_white():
    middle, light, dark = (episode(1, pixel_sd=10.0).expose(gray(value)).astype(int) for value in (128, 250, 3))
    added = middle - 128
    assert added.min() < -20 < 20 < added.max()
    np.testing.assert_array_equal(light, np.minimum(255, 250 + added))
    np.testing.assert_array_equal(dark, np.maximum(0, 3 + added))


def test_range_readings_drop_out_and_spike_as_often_as_they_say():
    read = readings(episode(range_dropout=0.05, range_spike=0.02))
    assert np.isinf(read).mean() == pytest.approx(0.05, abs=0.01)
    spikes = read[np.isfinite(read) & (read != 0.2)]
    assert len(spikes) / len(read) == pytest.approx(0.02, abs=0.007)
    assert REACH[0] <= spikes.min() < spikes.max() <= REACH[1]
    assert spikes.std() == pytest.approx(np.ptp(REACH) / np.sqrt(12), rel=0.2)


def test_range_readings_are_off_by_a_bias_of_the_episode_and_a_spread_of_each():
    noise = episode(1, range_bias=0.005, range_sd=0.002)
    read = readings(noise)
    assert abs(noise.range_bias) > 0.001
    assert read.mean() - 0.2 == pytest.approx(noise.range_bias, abs=2e-4)
    assert read.std() == pytest.approx(0.002, rel=0.05)


def test_beyond_its_reach_the_sensor_sees_nothing_and_nearer_it_reports_its_shortest():
    noise = episode()
    assert np.isinf([noise.read(distance, REACH) for distance in (0.41, np.inf)]).all()
    assert noise.read(0.01, REACH) == 0.04
