"""What a set is made of: impossible values are refused, and equal recipes are equal as data."""

import json
from dataclasses import fields, replace

import numpy as np
import pytest

from gvp_lib.errors import InvalidParameterError, UnknownNameError
from gvp_lib.learning.recipe import CollectionRecipe, Variation
from gvp_lib.perception.segmentation import HsvThreshold
from gvp_lib.simulation.arms import arm_spec
from gvp_lib.simulation.objects import CanonicalNormal, object_spec
from gvp_lib.simulation.sensors import Noise

pytestmark = pytest.mark.check


def as_text(recipe):
    return json.dumps(recipe.to_dict(), sort_keys=True)


def test_by_default_it_is_the_thesis_s_uniform_set():
    recipe = CollectionRecipe()
    assert (recipe.arm, recipe.sampling, recipe.n, recipe.crop, recipe.scenes) == ("ur5e", "uniform", 4096, 128, 1)
    assert np.degrees([recipe.max_tilt, recipe.sigma, recipe.step]) == pytest.approx([30, 15, 5])
    assert recipe.radius == 0.5
    assert recipe.noise == Noise.none()
    assert recipe.variation == Variation()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"n": 0}, r"n is a whole number from 1 to 10000000; got 0"),
        ({"n": 16.0}, r"n is a whole number .*got 16\.0"),
        ({"n": True}, r"n is a whole number .*got True"),
        ({"rolls": 0}, r"rolls is a whole number from 1 to 10000; got 0"),
        ({"crop": 8}, r"crop is a whole number from 16 to 4096; got 8"),
        ({"scenes": 0}, r"scenes is a whole number from 1 to 1000000; got 0"),
        ({"seed": -1}, r"seed is a whole number from 0 to \d+; got -1"),
        ({"shard": 0}, r"shard is a whole number from 1 to 100000; got 0"),
        ({"max_tilt": 30}, r"max_tilt is in radians, in \(0, 1\.571\]; got 30\. For degrees: np\.radians"),
        ({"max_tilt": 0}, r"max_tilt is in radians.*got 0"),
        ({"max_tilt": float("nan")}, r"max_tilt is in radians.*got nan"),
        ({"step": 5}, r"step is in radians, in \(0, 1\.571\]; got 5"),
        ({"step": -0.1}, r"step is in radians.*got -0\.1"),
        ({"sigma": 15}, r"sigma is in radians, in \(0, 3\.142\]; got 15"),
        ({"radius": 0.0}, r"radius is from 0\.05 to 2\.0; got 0\.0"),
        ({"radius": 500}, r"radius is from 0\.05 to 2\.0; got 500"),
        ({"radius": float("nan")}, r"radius is from .*got nan"),
        ({"threshold": 0}, r"threshold is from 0\.1 to 100\.0; got 0"),
        ({"n": 3, "rolls": 1, "scenes": 4}, r"3 samples are too few for 4 scenes"),
        ({"n": 100}, r"n is a multiple of rolls x scenes = 16; got n=100, and 96 or 112 would do"),
        ({"n": 48, "scenes": 2}, r"rolls x scenes = 32; got n=48, and 32 or 64 would do"),
        ({"noise": 0.1}, r"noise is a Noise and variation a Variation; got 0\.1"),
        ({"variation": {"light": 0.3}}, r"noise is a Noise and variation a Variation; .*'light': 0\.3"),
    ],
)
def test_an_impossible_value_is_refused_by_name_with_what_would_work(options, said):
    with pytest.raises(InvalidParameterError, match=said):
        CollectionRecipe(**options)


@pytest.mark.parametrize(("n", "low", "high"), [(100, 96, 112), (48, 32, 64)])
def test_the_numbers_that_would_do_do(n, low, high):
    scenes = 1 if n == 100 else 2
    for would in (low, high):
        assert CollectionRecipe(n=would, scenes=scenes).n == would


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"target": "cuboid_1x5"}, "no object named 'cuboid_1x5'.*cuboid_1x2"),
        ({"arm": "ur3"}, "no arm named 'ur3'.*ur5e"),
        ({"placement": "upright"}, "no placement named 'upright'.*Known: flat"),
        ({"sampling": "even"}, "no sampling named 'even'.*Known: random, uniform"),
    ],
)
def test_an_unknown_name_is_refused_with_those_that_are_known(options, said):
    with pytest.raises(UnknownNameError, match=said):
        CollectionRecipe(**options)


@pytest.mark.parametrize(("name", "bad"), [("light", 1.5), ("color", -0.1), ("table", 2), ("size", float("nan"))])
def test_an_impossible_variation_is_refused(name, bad):
    with pytest.raises(InvalidParameterError, match=rf"Variation\.{name} is a share, from 0 \(none\) to .*got {bad}"):
        Variation(**{name: bad})


def test_a_random_set_may_have_any_number_of_samples():
    assert CollectionRecipe(sampling="random", n=101, scenes=3).per_scene == [34, 34, 33]


@pytest.mark.parametrize(
    "options", [{}, {"sigma": None}, {"noise": Noise.thesis()}, {"variation": Variation(size=0.1)}]
)
def test_as_data_it_is_json_and_comes_back_the_same(options):
    told = CollectionRecipe(**options).to_dict()
    assert json.loads(json.dumps(told)) == told
    assert set(told) == {item.name for item in fields(CollectionRecipe)}


def test_equal_recipes_are_equal_data_whatever_kind_of_number_they_were_given():
    plain = CollectionRecipe(n=64, seed=3, radius=0.5, step=0.1)
    other = CollectionRecipe(n=np.int64(64), seed=np.int32(3), radius=np.float64(0.5), step=np.float64(0.1))
    assert as_text(plain) == as_text(other)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("target", "cuboid_1x3"), ("placement", "side"), ("arm", "baxter"), ("sampling", "random"), ("n", 32),
        ("rolls", 8), ("sigma", 0.1), ("max_tilt", 0.1), ("radius", 0.4), ("step", 0.1), ("sort", False),
        ("crop", 240), ("threshold", 1.0), ("scenes", 2), ("noise", Noise.thesis()),
        ("variation", Variation(light=0.1)), ("seed", 1), ("shard", 32),
    ],
)  # fmt: skip
def test_whatever_is_different_makes_it_another_recipe(name, value):
    base = CollectionRecipe(n=64)
    told, other = base.to_dict(), replace(base, **{name: value}).to_dict()
    assert [key for key in told if told[key] != other[key]] == [name]


def test_an_object_of_your_own_is_named_with_a_hash():
    brick = object_spec("cuboid_1x2")
    own = replace(brick, name="mine")
    told = CollectionRecipe(target=own).to_dict()["target"]
    assert told.startswith("mine (")
    assert told == CollectionRecipe(target=replace(brick, name="mine")).to_dict()["target"]
    json.dumps(told)


@pytest.mark.parametrize(
    "change",
    [
        {"mjcf": object_spec("cuboid_1x3").mjcf},
        {"normals": (CanonicalNormal((1, 0, 0)),)},
        {"round_axis": (1.0, 0.0, 0.0)},
        {"segmenter": HsvThreshold(hue=(100, 140))},
        {"textures": {"label": np.zeros((6, 1, 3), np.uint8)}},
    ],
)
def test_an_object_of_your_own_that_gives_another_set_has_another_hash(change):
    """Labels depend on its normals, centering on its segmenter."""
    own = replace(object_spec("cuboid_1x2"), name="mine")
    other = replace(own, **change)
    assert CollectionRecipe(target=own).to_dict()["target"] != CollectionRecipe(target=other).to_dict()["target"]


def any_red(rgb):
    return rgb[..., 0] > 128


def test_a_segmenter_that_is_a_function_has_the_same_hash_in_every_process():
    own = replace(object_spec("cuboid_1x2"), name="mine", segmenter=any_red)
    assert " at 0x" in repr(any_red)

    def any_red_again(rgb):
        return rgb[..., 0] > 128

    any_red_again.__qualname__, any_red_again.__module__ = any_red.__qualname__, any_red.__module__
    again = replace(own, segmenter=any_red_again)
    assert CollectionRecipe(target=own).to_dict() == CollectionRecipe(target=again).to_dict()


def test_an_arm_of_your_own_is_named_with_a_hash():
    ur5e = arm_spec("ur5e")
    told = CollectionRecipe(arm=replace(ur5e, name="mine")).to_dict()["arm"]
    assert told.startswith("mine (")
    for change in ({"home": tuple(np.add(ur5e.home, 0.1))}, {"joint_speed": 0.5}, {"fovy": 0.7}):
        assert CollectionRecipe(arm=replace(ur5e, name="mine", **change)).to_dict()["arm"] != told
