"""What may differ from picture to picture, and what it leaves alone."""

import numpy as np
import pytest
from viewpoint_sets import collect, contents, pictures, small, table

from gvp_lib.learning.recipe import Painter, Variation, resized
from gvp_lib.simulation.objects import OBJECTS, ObjectSpec
from gvp_lib.simulation.sensors import Noise
from gvp_lib.simulation.workcell import WorkCell


def test_nothing_is_varied_by_default(plain, tmp_path):
    collect(tmp_path / "set", small(variation=Variation(), noise=Noise.none()))
    assert contents(tmp_path / "set") == contents(plain)


@pytest.mark.parametrize("name", ["light", "color", "table", "noise"])
def test_each_variation_changes_pictures_and_hardly_a_label(name, plain, tmp_path):
    varied = {"noise": Noise(pixel_sd=2.0)} if name == "noise" else {"variation": Variation(**{name: 0.3})}
    collect(tmp_path / "set", small(**varied))
    assert all((a != b).any() for a, b in zip(pictures(tmp_path / "set"), pictures(plain), strict=True))
    for column in ("angle", "tilt"):
        here, there = (table(folder)[column].to_numpy() for folder in (tmp_path / "set", plain))
        np.testing.assert_allclose(here, there, atol=0.01)


def test_painting_twice_alike_is_painting_once():
    with WorkCell("floating") as cell:
        painter = Painter(cell, Variation(light=0.3, color=0.3, table=0.5))
        seen = []
        for seed in (1, 1, 2, 1):
            painter.paint(np.random.default_rng(seed))
            seen.append(cell.arm.capture())
    np.testing.assert_array_equal(seen[0], seen[1])
    np.testing.assert_array_equal(seen[0], seen[3])
    assert (seen[0] != seen[2]).any()


@pytest.mark.parametrize("name", OBJECTS)
def test_a_resized_object_has_a_scaled_bounding_box(name):
    before, after = OBJECTS[name].bounding_box(), resized(OBJECTS[name], 1.2).bounding_box()
    np.testing.assert_allclose(after.half_extents, 1.2 * before.half_extents, rtol=1e-4)
    np.testing.assert_allclose(after.center, 1.2 * before.center, atol=1e-6)


def test_two_scenes_have_two_placings_and_a_larger_crop_is_kept(tmp_path):
    collect(tmp_path / "set", small(scenes=2, crop=240))
    rows = table(tmp_path / "set").to_pandas()
    assert rows["scene"].tolist() == [0] * 8 + [1] * 8
    assert len({tuple(pose) for pose in rows["world_from_object"]}) == 2
    assert {picture.shape for picture in pictures(tmp_path / "set")} == {(240, 240, 3)}


@pytest.mark.parametrize("folder", ["", "shapes"])
def test_a_mesh_from_a_file_is_resized_too_and_found_from_anywhere(folder, tmp_path, monkeypatch):
    (tmp_path / folder).mkdir(exist_ok=True)
    corners = [(x, y, z) for x in (-0.03, 0.03) for y in (-0.02, 0.02) for z in (-0.01, 0.01)]
    faces = [
        (1, 2, 4),
        (1, 4, 3),
        (5, 8, 6),
        (5, 7, 8),
        (1, 6, 2),
        (1, 5, 6),
        (3, 4, 8),
        (3, 8, 7),
        (1, 3, 7),
        (1, 7, 5),
    ]
    faces += [(2, 8, 4), (2, 6, 8)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {a} {b} {c}" for a, b, c in faces]
    (tmp_path / folder / "bar.obj").write_text("\n".join(lines))
    document = tmp_path / "bar.xml"
    document.write_text(f"""<mujoco><compiler meshdir="{folder}"/><asset><mesh name="m" file="bar.obj"/></asset>
      <worldbody><body><geom type="mesh" mesh="m"/></body></worldbody></mujoco>""")
    monkeypatch.chdir(tmp_path)
    for mjcf in (document, "bar.xml", str(document)):
        larger = resized(ObjectSpec("bar", mjcf, lambda rgb: rgb[..., 0] > 0), 1.5)
        np.testing.assert_allclose(larger.bounding_box().half_extents, (0.045, 0.03, 0.015), rtol=1e-4)
        WorkCell("floating", larger).close()
