"""The page that is handed in, of a linear train with limits and a title block: its first
page, compliance, critical speeds, elements, other words, and its print as PDF.
"""

import dataclasses
import re
import tomllib

import numpy as np
import pytest
from page_cases import CHROMIUM, figures, tables
from reference_data import DATA, text_of

import jaxhb
from jaxhb.cli.main import main
from jaxhb.elements.rules.chosen import File
from jaxhb.report.compute import Asked, solve_cases
from jaxhb.report.figures.equivalent import ROOM, SIZE, equivalent_system
from jaxhb.report.files.browser import VARIABLE, find_browser, page_numbers
from jaxhb.report.files.output import OutputError
from jaxhb.report.page import page
from jaxhb.report.page.elements import forward_end
from jaxhb.report.page.first_page import compliance
from jaxhb.report.page.judgement import limits
from jaxhb.report.page.page import Page
from jaxhb.report.page.parts import Report
from jaxhb.report.page.words import Words, read_words
from jaxhb.report.table import Table
from jaxhb.scene.files import scene_title_block

TITLE = """
[report]
yard = "Werft <Süd>"
hull = 4711
class = "DNV"
revision = "B"
date = 2026-11-20
logo = "logo.svg"
"""
LOGO = '<svg xmlns="http://www.w3.org/2000/svg" width="9" height="9"/>'
LOW = 300
HIGH = 1000
SPEEDS = f"{LOW}:{HIGH}:8"


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """The page of the line with limits, its file, and the file of its phrases."""
    folder = tmp_path_factory.mktemp("plant")
    scene = folder / "line.toml"
    scene.write_text(text_of("limited_line.toml") + TITLE, encoding="utf-8")
    (folder / "logo.svg").write_text(LOGO, encoding="utf-8")
    made = []

    def recorded(*arguments):
        made.append(page_of(*arguments))
        return made[-1]

    page_of = page.as_page
    command = ["report", str(scene), "--rpm", SPEEDS, "--quiet"]
    command += ["--html", str(folder / "line.html")]
    command += ["--phrases", str(folder / "phrases.toml")]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page, "as_page", recorded)
        assert main(command) == 0
    (made_page,) = made
    return made_page, folder


def parts_by_title(made):
    """Parts of a page by their titles."""
    return {part.title: part for part in made.parts}


def fine_response():
    """The train and its forced response at many more speeds than its page has."""
    train = jaxhb.load_scene("tests/data/scenes/limited_line.toml")
    return train, jaxhb.forced_response(train, rpm=np.linspace(LOW, HIGH, 4001))


@pytest.mark.slow
def test_a_linear_train_is_judged_at_the_speeds_between_those_given(pages):
    made, _ = pages
    assert not [part.title for part in made.parts if part.failed]
    _, response = fine_response()
    answer = tables(parts_by_title(made)["Result"])[0]
    shown = dict(zip(answer.columns[0], answer.columns[5], strict=True))
    heat = {name: np.max(response.power(name)) for name in ("coupling", "ring")}
    # The page has the critical speeds of the undamped train, beside the peaks.
    assert float(shown["coupling"]) == pytest.approx(heat["coupling"] / 300, rel=0.01)
    assert float(shown["ring"]) == pytest.approx(heat["ring"] / 40, rel=0.01)
    # Between the eight speeds lies the resonance: there alone it is above its limit.
    answers = made.report.cases[0].answers
    assert max(each.power("coupling") for each in answers) < 300 < heat["coupling"]
    statement = tables(parts_by_title(made)["Statement of compliance"])[0]
    said = dict(zip(statement.columns[0], statement.columns[-1], strict=True))
    assert said == {
        "ring": "does NOT comply",
        "pinion|wheel": "does NOT comply",
        "line shaft": "complies with barred ranges",
        "coupling": "does NOT comply",
    }


@pytest.mark.slow
def test_the_page_of_a_linear_train_leaves_out_what_backlash_adds(pages):
    made, _ = pages
    parts = parts_by_title(made)
    for title in ("Tooth forces", "Torques of gears", "Accuracy and computed bounds"):
        assert title not in parts
    heads = {
        head for part in made.parts for table in tables(part) for head in table.heads
    }
    assert not heads & {"with", "without", "ratio", "motion"}


@pytest.mark.slow
def test_critical_speeds_have_the_stress_of_their_order_alone(pages):
    made, _ = pages
    table = tables(parts_by_title(made)["Campbell diagram and critical speeds"])[0]
    row = {
        head: column[0] for head, column in zip(table.heads, table.columns, strict=True)
    }
    assert row["order"] == "1.5"
    assert row["shaft"] == row["nodes in"] == "line shaft"
    train, _ = fine_response()
    response = jaxhb.forced_response(train, rpm=float(row["rpm"]))
    signal = response.torque("line shaft")
    amplitude = float(signal.amplitudes[signal.orders.tolist().index(1.5)])
    section = np.pi / 16 * 0.11**3
    # The speed is rounded to 0.1 rpm, at a resonance with a magnifier of about 20.
    assert float(row["stress MPa"]) == pytest.approx(
        1e-6 * amplitude / section, rel=0.02
    )
    end = response.disk("engine")
    angle = np.rad2deg(float(end.amplitudes[end.orders.tolist().index(1.5)]))
    assert float(row["angle deg"]) == pytest.approx(angle, rel=0.02)


@pytest.mark.slow
def test_every_element_and_the_forward_end_have_a_figure_with_their_limits(pages):
    made, _ = pages
    drawn = figures({"": parts_by_title(made)["Elements over the speed"]})
    begins = [figure.caption.partition(":")[0] for figure in drawn]
    assert begins == [
        "coupling",
        "coupling",
        "line shaft",
        "ring",
        "ring",
        "pinion - wheel",
        "pinion",
        "wheel",
        "engine, forward end",
    ]
    stress = drawn[2]
    assert [trace["name"] for trace in stress.traces[1:]] == [
        "continuous limit",
        "transient limit",
    ]
    assert len(stress.bands) == 1
    assert all(figure.narrow for figure in drawn)


@pytest.mark.slow
def test_the_title_block_and_the_logo_stand_in_the_file(pages):
    made, folder = pages
    text = (folder / "line.html").read_text(encoding="utf-8")
    assert "<th>Yard</th><td>Werft &lt;Süd&gt;</td><th>Hull</th><td>4711</td>" in text
    assert '<img class="logo" src="data:image/svg+xml;base64,' in text
    assert "logo.svg" not in re.sub("<details.*?</details>", "", text, flags=re.DOTALL)
    head = re.search(r'@top-left \{ content: "(.*?)"', text)[1]
    assert re.sub(r"\\([0-9a-f]+) ", lambda found: chr(int(found[1], 16)), head) == (
        "Werft <Süd>, 4711, rev. B"
    )
    assert made.report.title.date == "2026-11-20"


@pytest.mark.slow
def test_other_words_stand_in_the_place_of_all_phrases_of_the_file(pages):
    made, folder = pages
    phrases = tomllib.loads((folder / "phrases.toml").read_text(encoding="utf-8"))
    assert {"Result", "at rpm", "does NOT comply", "Yard", "Signature"} <= {*phrases}
    assert not {"coupling", "line shaft", "Werft <Süd>"} & {*phrases}
    given = {"Result": "Ergebnis", "share": "Anteil", "Signature": "Unterschrift"}
    words = Words(given, made.words.names)
    parts = page.parts_of(made.report, {"Result": page.PARTS["Result"]}, words)
    text = Page(made.report, parts, words).html().decode()
    assert "&ensp;Ergebnis</h2>" in text
    assert ">Anteil</th>" in text
    assert "<th>Unterschrift</th>" in text
    assert "<th>Signature</th>" not in text


def test_words_leave_names_and_numbers_and_replace_the_longest_phrase():
    words = Words({"gear": "Rad", "gear torque": "Radmoment"}, ["gear box"])
    assert words("gear torque of gear box, 12 gear") == "Radmoment of gear box, 12 Rad"
    assert words("gears") == "gears"
    assert words("gear box") == "gear box"


def test_words_that_are_no_texts_are_refused(tmp_path):
    file = tmp_path / "words.toml"
    file.write_text('"share" = 7\n')
    with pytest.raises(OutputError, match="'share' is 7, must be a text"):
        read_words(str(file))
    with pytest.raises(OutputError, match="there is no such file"):
        read_words(str(tmp_path / "other.toml"))


@pytest.mark.slow
@pytest.mark.skipif(
    CHROMIUM is None, reason="no chromium is installed: apt-get install chromium"
)
def test_the_pdf_has_drawn_figures_and_the_pages_of_its_contents(pages, tmp_path):
    made, _ = pages
    some = [part for part in made.parts if part.title in ("Result", "Limits")]
    drawn = [part for part in made.parts if part.title == "Elements over the speed"]
    sizes = []
    for parts in (some, some + drawn):
        short = dataclasses.replace(made, parts=parts)
        pdf = b"".join(page_writer(short))
        assert pdf.startswith(b"%PDF")
        numbers = page_numbers(pdf)
        assert [*sorted(numbers)] == [f"part-{k + 1}" for k in range(len(parts))]
        sizes.append(len(pdf))
    # Nine figures: thousands of points of lines, not of words alone.
    assert sizes[1] > sizes[0] + 30_000


def page_writer(made):
    """Bytes of the PDF of a page."""
    from jaxhb.report.files.formats import FORMATS

    return FORMATS["pdf"].write("page.pdf", made)


def test_a_machine_without_a_browser_is_told_what_to_do(monkeypatch):
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setattr("jaxhb.report.files.browser.PLACES", {})
    with pytest.raises(OutputError, match="a browser prints the page, and none was"):
        find_browser()
    monkeypatch.setenv(VARIABLE, "no such browser")
    with pytest.raises(OutputError, match=f"{VARIABLE} is 'no such browser'"):
        find_browser()


def chain(disks):
    """A chain of disks with long names."""
    parts = [
        jaxhb.Disk(name=f"disk with number {k}", inertia=0.1 + 0.0123456 * k)
        for k in range(disks)
    ]
    parts += [
        jaxhb.Shaft(
            between=(f"disk with number {k}", f"disk with number {k + 1}"),
            stiffness=1.23456e6,
        )
        for k in range(disks - 1)
    ]
    return jaxhb.build(parts, reference=parts[0].name)


@pytest.mark.parametrize("disks", [10, 100, 1000])
def test_texts_of_the_equivalent_system_never_overlap(disks):
    strips = equivalent_system(chain(disks)).strips
    names = []
    numbers = 0
    for strip in strips:
        rows = {}
        pattern = (
            r'<text x="([\d.]+)" y="([\d.]+)"[^>]*?( textLength="[^>]*?Glyphs")?'
            r'( class="name")?>([^<]*)<'
        )
        for x, y, squeezed, name, words in re.findall(pattern, strip):
            # Letters of Arial are on average narrower than 0.56 of their size.
            width = ROOM if squeezed else 0.56 * SIZE * len(words)
            rows.setdefault(float(y), []).append((float(x) - width / 2, width))
            names += [words] * bool(name)
            numbers += not name
        heights = sorted(rows)
        assert min(np.diff(heights)) >= SIZE
        for row in rows.values():
            ends = sorted((left, left + width) for left, width in row)
            for (_, end), (begin, _) in zip(ends, ends[1:], strict=False):
                assert end <= begin
    assert numbers == disks + disks - 1
    # Names are broken into two lines.
    assert names.count("disk with") == disks
    assert names.count(f"number {disks - 1}") == 1


def test_the_forward_end_is_the_far_end_of_the_reference_rotor():
    for scene, end in (
        ("six_cylinder_diesel", "pulley"),
        ("tests/data/scenes/limited_line.toml", "engine"),
    ):
        train = jaxhb.load_scene(scene)
        assert train.topology.disk_names[forward_end(train)] == end


def test_keys_of_the_title_block_are_checked_when_a_scene_is_loaded(tmp_path):
    scene = tmp_path / "line.toml"
    text = text_of("limited_line.toml")
    scene.write_text(text + '[report]\nhul = "7"\nlogo = "none.png"\nclass = [1]\n')
    with pytest.raises(jaxhb.SceneError) as refused:
        jaxhb.load_scene(scene)
    assert refused.value.sentences == (
        "line.toml, [report]: unknown key 'hul'. Did you mean 'hull'?",
        "line.toml, [report]: class is [1], must be a text. Put it in quotes.",
        "line.toml, [report]: logo: there is no file 'none.png' in the folder of the"
        " scene. Correct the name.",
    )
    scene.write_text(text + '[report]\nsite = "Halle 3"\nunits = { torque = "kN m" }\n')
    assert jaxhb.load_scene(scene).report_units == {"torque": "kN m"}
    block, _ = scene_title_block(scene)
    assert block.rows == [("Site", "Halle 3")]


def test_a_page_is_judged_by_a_rule_of_the_user():
    name = "intermediate_shafts.toml"
    rule = File(name, (DATA / "rules" / name).read_text())
    train = jaxhb.load_scene("tests/data/scenes/limited_line.toml").with_rules(rule)
    report = Report(solve_cases({"firing": train}, [600.0], Asked()), facts={})
    (table, *notes) = compliance(report)
    assert isinstance(table, Table)
    assert "intermediate shafts" in table.columns[2]
    assert any("For steel that counts up to 800 MPa." in str(note) for note in notes)
    assert limits(report)
