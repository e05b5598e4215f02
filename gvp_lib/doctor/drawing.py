"""Draw a red box without a screen, and print what came of it: a program for :mod:`gvp_lib.doctor.rendering`.

It is a process of its own because a graphics driver that fails may take the whole process with it.
"""

from __future__ import annotations

import json
import time

import mujoco

FRAMES = 10
SCENE = """
<mujoco>
  <worldbody>
    <light pos="0 0 3" castshadow="false"/>
    <geom type="box" size="1 1 0.1" rgba="1 0 0 1"/>
    <camera pos="0 0 1"/>
  </worldbody>
</mujoco>
"""


def draw() -> dict[str, object]:
    """Draw one frame and some more.

    Returns
    -------
    dict
        ``first`` and ``frame``, s: the time of the first frame, with the making of the renderer, and of one of the
        next; ``red``: whether the picture shows the box; ``driver``: what draws, in its own words.
    """
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    start = time.perf_counter()
    with mujoco.Renderer(model, height=480, width=640) as renderer:
        renderer.update_scene(data, camera=0)
        renderer.render()
        first = time.perf_counter()
        for _ in range(FRAMES):
            renderer.update_scene(data, camera=0)
            image = renderer.render()
        last = time.perf_counter()
        driver = _driver()
    red, green, _ = (int(value) for value in image.mean(axis=(0, 1)))
    shows_box = red > 100 and red > 2 * green
    return {"first": first - start, "frame": (last - first) / FRAMES, "red": shows_box, "driver": driver}


def _driver() -> str:
    try:
        from OpenGL import GL

        return bytes(GL.glGetString(GL.GL_RENDERER)).decode()
    except Exception:  # nothing depends on the name, and OpenGL bindings fail in many ways
        return "an unnamed driver"


if __name__ == "__main__":
    print(json.dumps(draw()))
