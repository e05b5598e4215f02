"""Models from files and texts of all kinds, arms and objects alike: found from anywhere, or refused in a line."""

import pickle
from dataclasses import replace
from pathlib import Path

import cv2
import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from gvp_lib.errors import InvalidParameterError, ModelError
from gvp_lib.learning.recipe import CollectionRecipe, scaled_object
from gvp_lib.perception.segmentation import Saliency
from gvp_lib.simulation.arms import ArmSpec
from gvp_lib.simulation.kinematics import InverseKinematics
from gvp_lib.simulation.objects import ObjectSpec
from gvp_lib.simulation.workcell import WorkCell

# A tetrahedron of 60 x 40 x 20 mm and its texture, in files that are named in one that a model includes.
MESH = "v 0 0 0\nv .06 0 0\nv 0 .04 0\nv 0 0 .02\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
INCLUDED = """<mujoco><asset><mesh name="m" file="tip.obj"/>
  <texture name="t" type="2d" file="label.png"/><material name="t" texture="t"/></asset></mujoco>"""
MODEL = """<mujoco><compiler meshdir="shapes" texturedir="labels"/><include file="mesh.xml"/>
  <worldbody><body name="b">{}<geom type="mesh" mesh="m" material="t"/></body></worldbody></mujoco>"""
ARM, OBJECT = MODEL.format('<joint name="j"/><camera name="eye"/>'), MODEL.format("")
# The links before the camera's are fixed, and a fusing compiler would take "flange" and "tool" away.
LINK = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
URDF = f"""<?xml version="1.0"?>
<robot name="r">
  <link name="base">{LINK}</link><link name="arm">{LINK}</link><link name="flange"/><link name="tool"/>
  <joint name="j" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint>
  <joint name="f" type="fixed"><parent link="arm"/><child link="flange"/><origin xyz=".3 0 0"/></joint>
  <joint name="t" type="fixed"><parent link="flange"/><child link="tool"/><origin xyz=".1 0 0"/></joint>
</robot>"""


def arm(mjcf, **more) -> ArmSpec:
    return ArmSpec("mine", mjcf, "eye", ("j",), (0.0,), **more)


def thing(mjcf) -> ObjectSpec:
    return ObjectSpec("mine", mjcf, Saliency())


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Current and home folder, with the model's files; beside it another, with a model of the same names."""
    for name, mesh in (("here", MESH), ("there", MESH.replace(".06", ".6"))):
        (tmp_path / name / "shapes").mkdir(parents=True)
        (tmp_path / name / "shapes" / "tip.obj").write_text(mesh)
        if name == "here":
            (tmp_path / name / "labels").mkdir()
            cv2.imwrite(str(tmp_path / name / "labels" / "label.png"), np.full((8, 8, 3), 200, np.uint8))
        (tmp_path / name / "mesh.xml").write_text(INCLUDED)
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setenv("HOME", str(tmp_path / "here"))
    return tmp_path / "here"


def in_file(name: str, encoding: str = "utf-8"):
    def given(xml: str) -> str:
        Path("model.xml" if name.startswith("~") else name).write_text(xml, encoding=encoding)
        return name

    return given


@pytest.mark.parametrize(("role", "make", "xml"), [("arm", arm, ARM), ("target", thing, OBJECT)], ids=["arm", "object"])
@pytest.mark.parametrize(
    "given",
    [
        pytest.param(in_file("model.xml"), id="a relative path"),
        pytest.param(lambda xml: Path(in_file("model.xml")(xml)), id="a relative Path"),
        pytest.param(in_file("~/model.xml"), id="in the home folder"),
        pytest.param(in_file("model.xml", "utf-8-sig"), id="a byte order mark"),
        pytest.param(in_file("model.xml", "utf-16"), id="UTF-16"),
        pytest.param(in_file("model.mjcf"), id="another ending"),
        pytest.param(lambda xml: xml, id="text"),
        pytest.param(lambda xml: "\ufeff\n" + xml, id="text with a byte order mark"),
    ],
)
def test_a_model_in_any_form_is_the_same_from_wherever_the_process_has_gone(
    given, role, make, xml, folder, monkeypatch
):
    spec = make(given(xml))
    recipe = CollectionRecipe(**{role: spec})
    was = recipe.to_dict()
    monkeypatch.chdir(folder.parent / "there")
    assert recipe.to_dict() == was
    masses = [(each, 0.008) for each in (spec, replace(spec), pickle.loads(pickle.dumps(spec)))]  # kg; there it is 0.08
    if role == "target":
        masses.append((scaled_object(spec, 2.0), 0.064))
    for each, mass in masses:
        assert each.load().compile().body_mass.sum() == pytest.approx(mass, rel=1e-4)


def test_a_cell_begins_its_next_episode_from_another_folder(folder, monkeypatch):
    with WorkCell("floating", thing(in_file("model.xml")(OBJECT)), seed=1) as cell:
        monkeypatch.chdir(folder.parent)
        cell.reset(2)
        assert cell.seed == 2


@pytest.mark.parametrize("given", [lambda xml: xml, in_file("model.urdf")], ids=["text", "file"])
def test_a_urdf_is_a_model_too_and_none_of_its_links_is_fused_away(given, folder):
    spec = arm(given(URDF), camera_mount=("tool", RigidTransform.identity()))
    assert InverseKinematics(spec).forward([0.0]).translation == pytest.approx([0.4, 0, 0])


LONG = "x" * 5000


@pytest.mark.parametrize("make", [arm, thing], ids=["arm", "object"])
@pytest.mark.parametrize(
    ("mjcf", "error", "text"),
    [
        ("nowhere/ur5e.xml", ModelError, "there is no file '{here}/nowhere/ur5e.xml'; mjcf is the path of an MJCF or "),
        ("~/lost.xml", ModelError, "there is no file '{here}/lost.xml'"),
        ("shapes", ModelError, "'{here}/shapes' is a folder"),
        (LONG, ModelError, "there is no file"),
        (f"<mujoco><worldbody><!-- {LONG} -->", ModelError, "'mine' cannot be read: XML parse error"),
        (f"<html><!-- {LONG} --></html>", ModelError, "'mine' cannot be read: XML Error: Unrecognized XML model type"),
        (None, InvalidParameterError, "MJCF or URDF file, or the XML as a string; got None"),
        (OBJECT.encode() + LONG.encode(), InvalidParameterError, "or the XML as a string; got b'<mujoco>"),
        (mujoco.MjSpec(), InvalidParameterError, "of an MjSpec, give its to_xml()"),
    ],
)
def test_what_is_no_model_is_refused_in_a_line(mjcf, error, text, make, folder):
    with pytest.raises(error) as refusal:
        make(mjcf).load()
    assert text.format(here=folder) in str(refusal.value)
    assert len(str(refusal.value)) < 500


def test_a_recipe_of_a_model_that_is_not_there_is_refused_too(folder):
    with pytest.raises(ModelError, match=r"the MJCF of 'mine' cannot be read: there is no file '.*lost\.xml'"):
        CollectionRecipe(target=thing("lost.xml")).to_dict()
