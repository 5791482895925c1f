"""What the README shows is what the package takes."""

import ast
import re
import shlex
from pathlib import Path

import jaxhb
from jaxhb.show.cli import parser

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", TEXT, re.DOTALL)


def test_every_command_of_the_readme_is_understood():
    lines = [
        line.removeprefix("$ ") for kind in ("sh", "text") for block in blocks(kind) for line in block.splitlines()
    ]
    lines = [line.rpartition("&& .venv/bin/")[2] for line in lines]
    commands = [shlex.split(line, comments=True) for line in lines if line.startswith("jaxhb ")]
    assert len(commands) >= 9
    for _, *arguments in commands:
        parser().parse_args(arguments)


def test_the_scene_of_the_readme_is_a_scene(tmp_path):
    (scene,) = blocks("toml")
    file = tmp_path / "scene.toml"
    file.write_text(scene, encoding="utf-8")
    train = jaxhb.load_scene(file)
    assert train.topology.mesh_names == ("crank gear|pump gear",)
    assert train.topology.cylinder_names == ("cylinder 1",)


def test_the_engine_and_the_two_tables_of_the_readme_are_trains(tmp_path):
    (engine,) = [block for block in blocks("text") if block.startswith("[engine]")]
    throws = [f"throw {k}" for k in range(1, 6)]
    parts = [f'[[disk]]\nname = "{name}"\ninertia = 0.1\n' for name in throws]
    parts += [f"[[shaft]]\nbetween = {list(pair)}\nstiffness = 1e6\n" for pair in zip(throws, throws[1:], strict=False)]
    file = tmp_path / "engine.toml"
    file.write_text("".join([*parts, '[[load]]\ndisk = "throw 5"\n', engine]), encoding="utf-8")
    assert len(jaxhb.load_scene(file).topology.cylinder_names) == 10
    (table,) = [block for block in blocks("text") if block.startswith("name,")]
    (tmp_path / "pump.csv").write_text(table, encoding="utf-8")
    assert jaxhb.load_scene(tmp_path / "pump.csv").topology.mesh_names == ("crank gear|pump gear",)


def test_the_python_of_the_readme_uses_names_that_exist():
    code = "\n".join(blocks("python"))
    used = [node for node in ast.walk(ast.parse(code)) if isinstance(node, ast.Attribute)]
    of_package = {node.attr for node in used if isinstance(node.value, ast.Name) and node.value.id == "jaxhb"}
    assert of_package == set(of_package) & set(jaxhb.__all__)
    of_response = {node.attr for node in used if isinstance(node.value, ast.Name) and node.value.id == "r"}
    assert all(hasattr(jaxhb.Response, name) for name in of_response)


def test_the_pictures_of_the_readme_are_there():
    for name in re.findall(r"!\[[^]]*\]\(([^)]+)\)", TEXT):
        assert (ROOT / name).read_bytes().startswith(b"\x89PNG")
        assert (ROOT / name).stat().st_size < 150_000


def test_ci_runs_the_two_commands_of_the_readme():
    """It takes the lines that begin so, as they stand here, and says which it ran."""
    begin = "python3 -m venv .venv && "
    commands = [line for line in TEXT.splitlines() if line.startswith(begin)]
    assert [line.rpartition(" && ")[2].split()[0] for line in commands] == [".venv/bin/jaxhb", ".venv/bin/python"]
    assert commands == [line for block in blocks("sh") for line in block.splitlines() if ".venv" in line]
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert f"grep '^{begin}' README.md" in script and 'bash -c "$command"' in script
