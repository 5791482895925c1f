"""The README and the pages of the documentation show what the package takes."""

import ast
import dataclasses
import doctest
import io
import re
import shlex
import tomllib
from pathlib import Path

import click
import pytest

import jaxhb
from jaxhb.cli.main import program
from jaxhb.elements.elements import TABLES
from jaxhb.report.compute import Asked, answer_one
from jaxhb.report.files.formats import FORMATS
from jaxhb.report.files.numbers import labelled

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
README = (ROOT / "README.md").read_text(encoding="utf-8")
SKILL = ROOT / "jaxhb" / ".agents" / "skills" / "jaxhb" / "SKILL.md"
PAGES = {
    path: path.read_text(encoding="utf-8")
    for path in (ROOT / "README.md", SKILL, *sorted(DOCS.rglob("*.md")))
}
INSTALLED = "python3 -m venv .venv && "
MODULES = {"design", "report"}
LOAD = '[[load]]\ndisk = "throw 5"\n'


def blocks(language, text=None):
    texts = PAGES.values() if text is None else (text,)
    return [
        block
        for page in texts
        for block in re.findall(rf"```{language}\n(.*?)```", page, re.DOTALL)
    ]


def page(name):
    return PAGES[DOCS / name]


def lines_of_shell():
    languages = ("sh", "bash", "console", "text")
    lines = [
        line.removeprefix("$ ")
        for kind in languages
        for block in blocks(kind)
        for line in block.splitlines()
    ]
    return [line.rpartition("&& .venv/bin/")[2] for line in lines]


def test_every_command_shown_is_understood():
    commands = [
        shlex.split(line, comments=True)
        for line in lines_of_shell()
        if line.startswith("jaxhb ")
    ]
    assert len(commands) >= 30
    for _, name, *arguments in commands:
        command = program.commands.get(name)
        words = arguments[: [*arguments, "|"].index("|")]
        try:
            if command:
                command.make_context(name, words)
            else:
                program.make_context("jaxhb", [name, *words])
        except click.exceptions.Exit as ending:  # --version and --help print and end
            assert not ending.exit_code


def test_the_table_of_files_names_the_commands_that_write_them():
    options = {
        name: {flag for parameter in command.params for flag in parameter.opts}
        for name, command in program.commands.items()
    }
    rows = re.findall(
        r"\n\| `(--\w+) FILE[.\w]*` \| ([^|]+) \|", page("how_to/data_and_files.md")
    )
    assert [option for option, _ in rows] == [
        "--json",
        "--csv",
        "--xlsx",
        "--netcdf",
        "--trace",
        "--plot",
    ]
    for option, cell in rows:
        commands = [name for name, flags in options.items() if option in flags]
        assert sorted(re.findall(r"`(\w+)`", cell)) == sorted(commands)


def test_every_benchmark_shown_is_there():
    scripts = re.findall(r"python (benchmarks/\w+\.py)", "\n".join(PAGES.values()))
    assert len(scripts) >= 9
    assert all((ROOT / script).is_file() for script in scripts)


def test_whole_scenes_load_and_parts_of_scenes_have_keys_that_exist(tmp_path):
    scenes = 0
    for block in blocks("toml"):
        tables = tomllib.loads(block)
        for name, rows in tables.items():
            for row in rows if isinstance(rows, list) and name in TABLES else ():
                fields = dataclasses.fields(TABLES[name])
                assert set(row) <= {field.name for field in fields}, block
        if "disk" in tables:
            loaded("scene.toml", block, tmp_path)
            scenes += 1
    assert scenes


def loaded(name, text, folder):
    (folder / name).write_text(text, encoding="utf-8")
    return jaxhb.load_scene(folder / name).topology


def test_the_scene_engine_and_tables_of_the_pages_are_the_trains_described(tmp_path):
    (scene,) = [
        block
        for block in blocks("toml", page("reference/scene.md"))
        if "[[disk]]" in block
    ]
    topology = loaded("scene.toml", scene, tmp_path)
    assert topology.mesh_names == ("crank gear|pump gear",)
    assert topology.cylinder_names == ("cylinder 1",)
    (engine,) = [
        block
        for block in blocks("toml", page("reference/excitation.md"))
        if block.startswith("[engine]")
    ]
    throws = [f"throw {k}" for k in range(1, 6)]
    parts = [f'[[disk]]\nname = "{name}"\ninertia = 0.1\n' for name in throws]
    parts += [
        f"[[shaft]]\nbetween = {list(pair)}\nstiffness = 1e6\n"
        for pair in zip(throws, throws[1:], strict=False)
    ]
    text = "".join([*parts, LOAD, engine])
    assert len(loaded("engine.toml", text, tmp_path).cylinders.names) == 10
    (table,) = [
        block
        for block in blocks("text", page("how_to/other_programs.md"))
        if block.startswith("name,")
    ]
    assert loaded("pump.csv", table, tmp_path).mesh_names == ("crank gear|pump gear",)


def statements(block):
    """Code of a block: of a session, the lines that are typed."""
    examples = doctest.DocTestParser().get_examples(block)
    return "".join(example.source for example in examples) or block


def test_python_uses_names_that_exist():
    code = "\n".join(map(statements, blocks("python")))
    used = [
        node for node in ast.walk(ast.parse(code)) if isinstance(node, ast.Attribute)
    ]
    of_package = {
        node.attr
        for node in used
        if isinstance(node.value, ast.Name) and node.value.id == "jaxhb"
    }
    assert of_package - MODULES <= set(jaxhb.__all__)
    for name, kind in (
        ("r", jaxhb.Response),
        ("s", jaxhb.SteadyState),
        ("f", jaxhb.ForcedResponse),
    ):
        read = {
            node.attr
            for node in used
            if isinstance(node.value, ast.Name) and node.value.id == name
        }
        fields = {field.name for field in dataclasses.fields(kind)}
        assert read
        assert read <= set(dir(kind)) | fields


def test_the_reference_has_every_public_name_once():
    directive = r"^\.\. auto(?:function|class|exception):: jaxhb\.(?:design\.)?(\w+)$"
    pages = (DOCS / "reference" / "api").glob("*.md")
    listed = re.findall(directive, "\n".join(map(Path.read_text, pages)), re.M)
    public = {*jaxhb.__all__, *jaxhb.design.__all__}
    assert sorted(listed) == sorted(public)


@pytest.mark.parametrize("name", ["README.md", "CONTRIBUTING.md", "CHANGELOG.md"])
def test_links_and_pictures_lead_to_files(name):
    """The build of the pages in ``docs`` checks their links itself."""
    text = (ROOT / name).read_text(encoding="utf-8")
    links = [link for link in re.findall(r"\]\(([^)]+)\)", text) if "://" not in link]
    assert links or name != "README.md"
    files = {link: ROOT / link.partition("#")[0] for link in links}
    assert [link for link, file in files.items() if not file.is_file()] == []


def test_names_of_code_in_the_guide_for_contributors_exist():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    prose = re.sub(r"```.*?```", "", text, flags=re.S)
    names = set(re.findall(r"`(?:\w+\.)*(\w*[a-z]\w*)(?:\(.*?\))?`", prose))
    folders = ("jaxhb", "tests", "benchmarks", "docs", "notebooks")
    files = [path for folder in folders for path in (ROOT / folder).rglob("*.py")]
    words = set(re.findall(r"\w+", "\n".join(map(Path.read_text, files))))
    words |= {
        path.stem for folder in folders for path in (ROOT / folder).rglob("*")
    } | {"_hz", "_deg", "_rpm"}
    assert len(names) > 60
    assert names - words == set()


def test_pictures_are_small():
    shown = {
        path: re.findall(r"!\[[^]]*\]\(([^)]+)\)", text) for path, text in PAGES.items()
    }
    pictures = [
        (path.parent / link).read_bytes()
        for path, links in shown.items()
        for link in links
    ]
    assert len(pictures) >= 3
    assert all(picture.startswith(b"\x89PNG") for picture in pictures)
    assert all(len(picture) < 400_000 for picture in pictures)


def test_ci_runs_the_two_commands_of_the_readme():
    """CI takes the lines that begin so, word for word, and says which it ran."""
    commands = [line for line in README.splitlines() if line.startswith(INSTALLED)]
    assert [line.rpartition(" && ")[2].split()[0] for line in commands] == [
        ".venv/bin/jaxhb",
        ".venv/bin/python",
    ]
    lines = [line for block in blocks("sh", README) for line in block.splitlines()]
    assert commands == [line for line in lines if ".venv" in line]
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert f"grep '^{INSTALLED}' README.md" in script
    assert 'bash -c "$command"' in script


def test_the_papers_of_the_project_agree_with_the_package():
    def text_of(name):
        return (ROOT / name).read_text(encoding="utf-8")

    project = tomllib.loads(text_of("pyproject.toml"))["project"]
    assert project["version"] == jaxhb.__version__
    assert f"\nversion: {jaxhb.__version__}\n" in text_of("CITATION.cff")
    assert f"\n## {jaxhb.__version__}\n" in text_of("CHANGELOG.md")
    assert "Version 2.0, January 2004" in text_of("LICENSE")
    assert project["license"] == "Apache-2.0"


def test_every_variable_of_the_guide_on_files_is_in_a_data_set():
    xarray = pytest.importorskip("xarray")
    text = page("how_to/data_and_files.md")
    code = "\n".join(blocks("python", text))
    shown = set(re.findall(r"data\.([a-z_]+)", code)) - {"where", "sel"}
    parts = [
        jaxhb.Disk(name="a", inertia=1.0),
        jaxhb.Disk(name="b", inertia=1.0),
        jaxhb.Shaft(between=("a", "b"), stiffness=1e4, damping=1.0),
        jaxhb.Torque(disk="a", harmonics=[(1.0, 1.0, 0.0)]),
    ]
    forced = jaxhb.forced_response(jaxhb.build(parts), rpm=[900.0])
    answer = answer_one(jaxhb.load_scene("spur_pair"), 2000.0, Asked())
    data = labelled({"one": [answer]}, None, along="case")
    file = b"".join(FORMATS["netcdf"].write("", data))
    reported = xarray.open_dataset(io.BytesIO(file))
    assert shown
    assert shown <= {*forced.to_xarray(), *reported, *reported.coords}
    named = set(re.findall(r"`([a-z_]+)_\*`", text))
    heads = [*forced.to_xarray(), *reported]
    assert named
    assert named <= {head.removesuffix("_max") for head in heads}
