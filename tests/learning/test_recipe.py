"""What a set is made of: impossible values are refused, equal recipes are equal as data, viewpoints are spread as the
thesis's two sets are, and what is varied leaves all else alone."""

import json
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy import stats
from viewpoint_sets import collect, pictures, small

from gvp_lib.errors import GvpError
from gvp_lib.geometry.sphere import VirtualSphere
from gvp_lib.learning.recipe import CollectionRecipe, Painter, Variation, redrawn, scaled_object, tour, viewpoints
from gvp_lib.learning.shards import read_columns
from gvp_lib.perception.segmentation import HsvThreshold
from gvp_lib.simulation.arms import arm_spec
from gvp_lib.simulation.objects import OBJECTS, ObjectSpec, object_spec
from gvp_lib.simulation.sensors import Noise
from gvp_lib.simulation.truth import CanonicalNormal
from gvp_lib.simulation.workcell import WorkCell


@pytest.mark.check
def test_by_default_it_is_the_thesis_s_uniform_set():
    recipe = CollectionRecipe()
    assert (recipe.arm, recipe.sampling, recipe.n, recipe.crop, recipe.scenes) == ("ur5e", "uniform", 4096, 128, 1)
    assert np.degrees([recipe.max_tilt, recipe.sigma, recipe.step]) == pytest.approx([30, 15, 5])
    assert recipe.radius == 0.5
    assert (recipe.noise, recipe.variation) == (Noise.none(), Variation())


@pytest.mark.check
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"n": 0}, r"n is a whole number from 1 to 10000000; got 0"),
        ({"n": True}, r"n is a whole number .*got True"),
        ({"n": "64"}, r"n is a whole number .*got '64'"),
        ({"max_tilt": 30}, r"max_tilt is in radians, from .* to 1\.571; got 30\. For degrees: np\.radians"),
        ({"max_tilt": float("nan")}, r"max_tilt is in radians.*got nan"),
        ({"sigma": 15}, r"sigma is in radians, from .* to 3\.142; got 15"),
        ({"radius": 500}, r"radius is from 0\.05 to 2\.0; got 500"),
        ({"n": 3, "rolls": 1, "scenes": 4}, r"3 samples are too few for 4 scenes"),
        ({"n": 100}, r"n is a multiple of rolls x scenes = 16; got n=100, and 96 or 112 would do"),
        ({"noise": 0.1}, r"noise is a Noise and variation a Variation; got 0\.1"),
        ({"placement": "upright"}, "no placement named 'upright'.*Known: flat"),
        ({"sampling": "even"}, "no sampling named 'even'.*Known: random, uniform"),
        ({"light": 1.5}, r"Variation\.light is a share, from 0 \(none\) to 0\.9; got 1\.5"),
        ({"size": float("nan")}, r"Variation\.size is a share, .*got nan"),
    ],
)
def test_an_impossible_value_is_refused_by_name_with_what_would_work(options, message):
    with pytest.raises(GvpError, match=message):
        (Variation if {"light", "size"} & set(options) else CollectionRecipe)(**options)


@pytest.mark.check
def test_as_data_it_is_json_whatever_kind_of_number_it_was_given():
    plain = CollectionRecipe(n=64, seed=3, radius=0.5, sigma=None).to_dict()
    other = CollectionRecipe(n=np.int64(64), seed=np.int32(3), radius=np.float64(0.5), sigma=None).to_dict()
    assert json.loads(json.dumps(plain)) == json.loads(json.dumps(other)) == plain
    assert set(plain) == {item.name for item in fields(CollectionRecipe)}


@pytest.mark.check
def test_other_noise_or_variation_makes_it_another_recipe():
    plain = CollectionRecipe().to_dict()
    other = CollectionRecipe(noise=Noise(pixel_sd=2.0), variation=Variation(light=0.1)).to_dict()
    assert [name for name in plain if plain[name] != other[name]] == ["noise", "variation"]
    assert (other["noise"]["pixel_sd"], other["variation"]["light"]) == (2.0, 0.1)


def any_red(rgb):
    return rgb[..., 0] > 128


BRICK, ARM = replace(object_spec("cuboid_1x2"), name="mine"), replace(arm_spec("ur5e"), name="mine")


@pytest.mark.check
@pytest.mark.parametrize(
    ("name", "own", "changes"),
    [
        ("target", BRICK, [
            {"mjcf": object_spec("cuboid_1x3").mjcf},
            {"normals": (CanonicalNormal((1, 0, 0)),)},  # labels depend on it
            {"round_axis": (1.0, 0.0, 0.0)},
            {"segmenter": HsvThreshold(hue=(100, 140))},  # centering depends on it
            {"segmenter": any_red},
            {"textures": {"label": np.zeros((6, 1, 3), np.uint8)}},
        ]),
        ("arm", ARM, [{"home": (0.1, *ARM.home[1:])}, {"joint_speed": 0.5}, {"fovy": 0.7}]),
    ],
)  # fmt: skip
def test_an_object_or_arm_of_your_own_is_named_with_a_hash_of_all_that_gives_another_set(name, own, changes):
    named = [CollectionRecipe(**{name: replace(own, **change)}).to_dict()[name] for change in ({}, {}, *changes)]
    assert all(each.startswith("mine (") for each in named)
    assert len(set(named)) == len(named) - 1
    assert named[0] == named[1]


@pytest.mark.check
def test_a_segmenter_that_is_a_function_has_the_same_hash_in_every_process():
    def any_red_again(rgb):
        return rgb[..., 0] > 128

    assert " at 0x" in repr(any_red)
    any_red_again.__qualname__, any_red_again.__module__ = any_red.__qualname__, any_red.__module__
    here, there = (CollectionRecipe(target=replace(BRICK, segmenter=each)) for each in (any_red, any_red_again))
    assert here.to_dict() == there.to_dict()


CAP, SIGMA = np.radians(30), np.radians(15)


def recipe(**options):
    return CollectionRecipe(arm="floating", **options)


def truncated_rayleigh(tilt):
    """Distribution of the length of a normal tilt in the plane, cut at the cap."""
    return -np.expm1(-((tilt / SIGMA) ** 2) / 2) / -np.expm1(-((CAP / SIGMA) ** 2) / 2)


def uniform_in_area(tilt):
    return (1 - np.cos(tilt)) / (1 - np.cos(CAP))


def turn(a, b):
    """Angle of the rotation between two viewpoints, or between the rows of two arrays of them, rad."""
    one, other = (VirtualSphere(np.zeros(3), 1.0).viewpoint(*np.transpose(x)).rotation for x in (a, b))
    return (one.inv() * other).magnitude()


@pytest.mark.parametrize(
    ("options", "cdf"),
    [
        ({"sampling": "uniform"}, uniform_in_area),
        ({"sampling": "random"}, truncated_rayleigh),
        ({"sampling": "random", "sigma": None}, uniform_in_area),
    ],
)
def test_tilts_are_spread_as_asked_and_so_are_those_that_replace_them(options, cdf):
    own = recipe(n=2048, seed=3, **options)
    asked = viewpoints(own)
    drawn = redrawn(own, 0, 1, asked)
    for tilt in (asked[:, 0], drawn[:, 0]):
        assert tilt.max() <= CAP
        assert stats.kstest(tilt, cdf).pvalue > 0.01
    np.testing.assert_array_equal(drawn[:, 1:], asked[:, 1:])  # azimuth and roll stay


def test_each_point_of_a_uniform_set_has_evenly_spaced_rolls_from_the_offset():
    drawn = viewpoints(recipe(n=256, rolls=16, roll_offset=0.25, sort=False)).reshape(16, 16, 3)
    np.testing.assert_allclose(np.ptp(drawn[..., 0], axis=1), 0, atol=1e-9)
    rolls = np.sort(drawn[..., 2] % (2 * np.pi), axis=1)
    np.testing.assert_allclose(rolls, np.tile((np.arange(16) + 0.25) * np.pi / 8, (16, 1)), atol=1e-9)


def test_a_uniform_set_is_the_same_for_every_seed_and_scene_and_a_random_one_its_seed_s_and_scene_s():
    def drawn(sampling, seed, scene):
        return viewpoints(recipe(sampling=sampling, n=64, scenes=2, seed=seed), scene)

    np.testing.assert_array_equal(drawn("uniform", 1, 0), drawn("uniform", 2, 1))
    np.testing.assert_array_equal(drawn("random", 1, 0), drawn("random", 1, 0))
    assert not np.allclose(drawn("random", 1, 0), drawn("random", 2, 0))
    assert not np.allclose(drawn("random", 1, 0), drawn("random", 1, 1))


def test_sorting_changes_the_order_alone_and_turns_far_less_from_view_to_view():
    plain, ordered = (viewpoints(recipe(sampling="random", n=1024, sort=sort)) for sort in (False, True))
    assert sorted(map(tuple, plain.tolist())) == sorted(map(tuple, ordered.tolist()))
    assert turn(ordered[:-1], ordered[1:]).mean() < 0.2 * turn(plain[:-1], plain[1:]).mean()


coordinates = st.lists(
    st.tuples(st.floats(0, 1.5), st.floats(-np.pi, np.pi), st.floats(-np.pi, np.pi)), min_size=1, max_size=12
).map(np.array)


@given(coordinates)
@example(np.zeros((40, 3)))
@example(np.zeros((0, 3)))
def test_a_tour_visits_each_once_and_goes_on_to_the_nearest_that_is_left(given):
    order = tour(given)
    assert sorted(order.tolist()) == list(range(len(given)))
    here = np.zeros(3)
    for k in range(len(order)):
        turns = turn(np.broadcast_to(here, (len(order) - k, 3)), given[order[k:]])
        assert turns[0] <= turns.min() + 1e-6
        here = given[order[k]]


@pytest.mark.parametrize("name", ["light", "color", "table", "noise"])
def test_each_variation_changes_pictures_and_hardly_a_label(name, plain, tmp_path):
    varied = {"noise": Noise(pixel_sd=2.0)} if name == "noise" else {"variation": Variation(**{name: 0.3})}
    collect(tmp_path / "set", small(**varied))
    assert all((a != b).any() for a, b in zip(pictures(tmp_path / "set"), pictures(plain), strict=True))
    for column in ("angle", "tilt"):
        here, there = (read_columns(folder)[column].to_numpy() for folder in (tmp_path / "set", plain))
        np.testing.assert_allclose(here, there, atol=0.01)


def test_painting_twice_alike_is_painting_once():
    seen = []
    with WorkCell("floating") as cell:
        painter = Painter(cell, Variation(light=0.3, color=0.3, table=0.5))
        for seed in (1, 2, 1):
            painter.paint(np.random.default_rng(seed))
            seen.append(cell.arm.capture())
    np.testing.assert_array_equal(seen[0], seen[2])
    assert (seen[0] != seen[1]).any()


def test_two_scenes_have_two_placings_and_a_larger_crop_is_kept(tmp_path):
    collect(tmp_path / "set", small(sampling="random", n=15, scenes=2, crop=240))
    rows = read_columns(tmp_path / "set").to_pandas()
    assert rows["scene"].tolist() == [0] * 8 + [1] * 7
    assert len({tuple(pose) for pose in rows["world_from_object"]}) == 2
    assert {picture.shape for picture in pictures(tmp_path / "set")} == {(240, 240, 3)}


@pytest.mark.parametrize("name", OBJECTS)
def test_a_scaled_object_has_a_scaled_bounding_box(name):
    before, after = OBJECTS[name].bounding_box(), scaled_object(OBJECTS[name], 1.2).bounding_box()
    np.testing.assert_allclose(after.half_extents, 1.2 * before.half_extents, rtol=1e-4)
    np.testing.assert_allclose(after.center, 1.2 * before.center, atol=1e-6)


def test_a_mesh_from_a_file_is_scaled_too_and_found_from_anywhere(tmp_path, monkeypatch):
    (tmp_path / "shapes").mkdir()
    corners = "v 0 0 0\nv .06 0 0\nv 0 .04 0\nv 0 0 .02\n"
    (tmp_path / "shapes" / "tip.obj").write_text(corners + "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    mesh = '<compiler meshdir="shapes"/><asset><mesh name="m" file="tip.obj"/></asset>'
    body = '<worldbody><body><geom type="mesh" mesh="m"/></body></worldbody>'
    (tmp_path / "tip.xml").write_text(f"<mujoco>{mesh}{body}</mujoco>")
    monkeypatch.chdir(tmp_path)
    for mjcf in (tmp_path / "tip.xml", "tip.xml"):
        larger = scaled_object(ObjectSpec("tip", mjcf, lambda rgb: rgb[..., 0] > 0), 1.5)
        np.testing.assert_allclose(larger.bounding_box().half_extents, (0.045, 0.03, 0.015), rtol=1e-4)
