"""The page of ``jaxhb report --html``: its contents, in plain Python, and its drawing
by a browser without a network.
"""

import dataclasses
import json
import re
from types import SimpleNamespace

import numpy as np
import pytest
from page_cases import (
    CHROMIUM,
    SCENE,
    WIDE,
    WIDER,
    blocks,
    browse,
    figures,
    tables,
    without_an_answer,
)

from jaxhb.cli.main import main
from jaxhb.cli.page_command import second_text
from jaxhb.linear.forced import forced_response
from jaxhb.report.answer import Answer, Case
from jaxhb.report.figures.figure import NO_ANSWER
from jaxhb.report.figures.plotly import layout_of
from jaxhb.report.figures.speeds import over_speed
from jaxhb.report.page import linear, page, parts as page_parts
from jaxhb.report.page.judgement import shares_of
from jaxhb.report.page.page import parts_of
from jaxhb.report.page.parts import SPEEDS as LINEAR_SPEEDS
from jaxhb.report.quantities import forces
from jaxhb.report.table import Table
from jaxhb.report.text.sentences import verdict
from jaxhb.results.status import Status

SPEEDS = "1500,3000,4000"


@pytest.fixture(scope="module")
def written_page(tmp_path_factory):
    """A page from the command line, in a folder with blanks and umlauts: its file, the
    report and its parts.
    """
    folder = tmp_path_factory.mktemp("Prüfstand 2 – größer")
    (folder / "first.toml").write_text(SCENE, encoding="utf-8")
    damped = SCENE.replace("damping = 5.0, power", "damping = 25.0, power")
    (folder / "second.toml").write_text(damped, encoding="utf-8")
    file = folder / "Bericht & Anlage.html"
    command = [
        "report",
        str(folder / "first.toml"),
        "--rpm",
        SPEEDS,
        "--misfire",
        "two",
        "--html",
        str(file),
        "--tuned",
        str(folder / "second.toml"),
    ]
    reports = []

    def recorded_parts(report, sources, words):
        parts = parts_of(report, sources, words)
        reports.append((report, parts))
        return parts

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page, "parts_of", recorded_parts)
        assert main(command) == 0
    ((report, parts),) = reports
    return file, report, {part.title: part for part in parts}


@pytest.fixture(scope="module")
def page_file(written_page):
    """File of the page."""
    file, _, _ = written_page
    return file


@pytest.fixture(scope="module")
def report(written_page):
    """Report of the page."""
    _, report, _ = written_page
    return report


@pytest.fixture(scope="module")
def parts(written_page):
    """Parts of the page by their titles."""
    _, _, parts = written_page
    return parts


@pytest.mark.slow
def test_every_part_of_the_report_is_there(parts):
    # Tolerances and a transient are there where they are asked for, notes where there
    # is something to note.
    absent = ("Tolerances", "Transient", "Notes")
    expected = [title for title in page.PARTS if title not in absent]
    assert list(parts) == expected
    assert [title for title, part in parts.items() if part.failed] == []
    undrawn = [title for title, part in parts.items() if not figures({title: part})]
    without_figures = [
        "Result",
        "Statement of compliance",
        "Operating modes",
        "Train and data",
        "Assumptions and versions",
        "Torques of gears",
        "Torques of shafts and dampers",
        "Heat of dampers",
        "Limits",
        "Accuracy and computed bounds",
    ]
    assert undrawn == without_figures
    assert "<svg" in parts["Train and data"].html


@pytest.mark.slow
def test_tables_hold_the_numbers_of_the_answers(report, parts):
    normal, misfire = report.cases
    table = tables(parts["Torques of shafts and dampers"])[0]
    groups = [title for title, *_ in table.groups]
    assert groups == ["all cylinders firing", "two not firing"]
    row = table.columns[0].index("Welle")
    for case, first in ((normal, 1), (misfire, 5)):
        swings = [
            float(answer.torque("Welle").half_peak_to_peak) for answer in case.answers
        ]
        assert float(table.columns[first][row]) == pytest.approx(max(swings), rel=1e-3)
        speed = report.rpm[int(np.argmax(swings))]
        assert table.columns[first + 1][row] == f"{speed:g}"
    heat = tables(parts["Heat of dampers"])[0]
    assert heat.columns[0] == ["Dämpfer"]
    assert float(heat.columns[1][0]) > 0


@pytest.mark.slow
def test_irregularity_of_disks_is_in_per_cent_in_all_tables(report, parts):
    """Irregularity of the heaviest disk, the gears and the loads."""
    normal = report.cases[0].answers
    disks = ["Kurbel", "Räder", "Bremse"]
    over, _, largest = tables(parts["Motion over the speed"])[-3:]
    assert list(largest.columns[0]) == disks
    for first, case in ((1, report.cases[0]), (5, report.cases[1])):
        expected = [
            100 * max(answer.irregularity(disk) for answer in case.answers)
            for disk in disks
        ]
        shares = [float(cell) for cell in largest.columns[first]]
        assert shares == pytest.approx(expected, rel=2e-3)
    at_one_speed = next(
        table
        for table in tables(parts["One speed in full"])
        if "irregularity" in table.caption
    )
    assert over.heads[1] == "Kurbel"
    assert over.groups[0] == ("irregularity, %", 1, 1)
    expected = [answer.irregularity("Kurbel") for answer in normal]
    expected += [normal[report.place].irregularity(disk) for disk in disks]
    cells = [*over.columns[1], *at_one_speed.columns[1][:3]]
    assert [float(cell) / 100 for cell in cells] == pytest.approx(expected, rel=6e-3)


def largest_force(case):
    """Largest tooth force over the speeds of a case."""
    return max(float(answer.force("Kurbel|Räder").peak) for answer in case.answers)


@pytest.mark.slow
def test_the_second_design_stands_beside_the_first_with_what_differs(report, parts):
    differ, forces_of_both, *_ = tables(parts["Second design"])
    first_row = [column[0] for column in differ.columns]
    assert first_row == ["Dämpfer.damping", "5", "25", "N m s/rad"]
    assert len(differ.columns[0]) == 1
    groups = [title for title, *_ in forces_of_both.groups]
    assert groups == ["first design", "second design (second)"]
    largest = largest_force(report.seconds[0])
    assert float(forces_of_both.columns[7][0]) == pytest.approx(largest / 1e3, rel=1e-3)


def damper_share(answer):
    """Heat of the damper over its limit."""
    return answer.power("Dämpfer") / 500.0


def mesh_share(answer):
    """Vibratory torque of the mesh over a third of its rated torque."""
    return 0.05 * float(answer.force("Kurbel|Räder").half_peak_to_peak) / 300.0


@pytest.mark.slow
def test_the_result_judges_every_case_the_largest_share_first(report, parts):
    judged = list(shares_of(report.cases).values())
    shares = [largest.share for largest in judged]
    assert len(shares) == 3
    assert shares == sorted(shares, reverse=True)
    (answer,) = tables(parts["Result"])
    for name, share_of in (("Dämpfer", damper_share), ("Kurbel|Räder", mesh_share)):
        share, case, rpm = max(
            (share_of(each), case.title, each.rpm)
            for case in report.cases
            for each in case.answers
        )
        (largest,) = [largest for largest in judged if largest.name == name]
        assert largest.case == case
        assert largest.rpm == rpm
        assert largest.share == pytest.approx(share, rel=1e-9)
        row = answer.columns[0].index(name)
        shown = {
            head: column[row]
            for head, column in zip(answer.heads, answer.columns, strict=True)
        }
        assert shown["share"] == f"{share:.2f}"
        assert (shown["at rpm"], shown["case"]) == (f"{rpm:g}", case)
        verdict = shown[""]
        assert verdict == ("ABOVE" if share > 1 else "within")
        assert (row in answer.marked) == (share > 1)
        value, limit = float(shown["value"]), float(shown["limit"])
        assert value / limit == pytest.approx(share, rel=2e-3)
    cells = [float(cell) for cell in answer.columns[5] if cell != "-"]
    assert cells == sorted(cells, reverse=True)
    text = parts["Result"].html
    assert text.count('<tr class="above">') == len(answer.marked)


@pytest.mark.slow
def test_the_second_design_has_its_limits_its_heat_and_the_misfire(report, parts):
    heat = next(
        table
        for table in tables(parts["Second design"])
        if table.caption.startswith("Heat of dampers")
    )
    largest = max(answer.power("Dämpfer") for answer in report.seconds[0].answers)
    assert float(heat.columns[5][0]) == pytest.approx(largest, rel=1e-3)
    shares = tables(parts["Second design"])[-1]
    titles = [title for title, *_ in shares.groups]
    second = "second design (second)"
    assert titles[1:] == [
        second,
        "first design, two not firing",
        f"{second}, two not firing",
    ]
    cell = shares.columns[5][shares.columns[0].index("Dämpfer")]
    assert float(cell) == pytest.approx(largest / 500.0, abs=0.006)
    misfiring = report.seconds[1].answers[0].train
    assert misfiring.topology.cylinders.fires == (True, False)
    assert misfiring.value("Dämpfer.damping") == 25.0
    assert "was run without a misfire" not in parts["Second design"].html
    lines = second_text(report.cases, report.seconds).splitlines()
    force = largest_force(report.seconds[0])
    first = largest_force(report.cases[0])
    assert lines[0].startswith(
        f"The {second}: largest tooth force {force / 1e3:.4g} kN in Kurbel|Räder at "
    )
    assert lines[0].endswith(f" rpm ({100 * (force / first - 1):+.1f} %).")
    assert "two not firing" in lines[1]


@pytest.mark.slow
def test_a_second_design_without_the_cylinder_was_run_without_a_misfire(report):
    firing = dataclasses.replace(report, seconds=report.seconds[:1])
    (part,) = parts_of(firing, {"Second design": page.PARTS["Second design"]})
    assert (
        "The second design was run without a misfire: nothing here shows what a misfire"
        " does to it." in part.html
    )


@pytest.mark.slow
def test_the_linear_parts_name_their_case_and_have_the_misfire_too(report, parts):
    campbell = parts["Campbell diagram and critical speeds"]
    forced = parts["Linear forced response"]
    (diagram,) = figures({"": campbell})
    assert diagram.caption.startswith("Campbell diagram, all cylinders firing: ")
    (critical,) = tables(campbell)
    assert critical.heads[:5] == ["rpm", "order", "mode", "Hz", "nodes in"]
    assert critical.heads[-1] == "case"
    # Both cylinders act alike in whole orders: two do more than one.
    row = critical.columns[1].index("1")
    assert critical.columns[-1][row] == "all cylinders firing"
    for figure in figures({"": forced}):
        assert "over the speed, all cylinders firing, " in figure.caption
    beginning = forced.blocks.index("Largest values, two not firing")
    worst = blocks(forced.blocks[beginning:], Table)
    table = next(table for table in worst if "Welle" in table.columns[0])
    speeds = np.unique([*report.rpm, *np.linspace(1500, 4000, LINEAR_SPEEDS)])
    response = forced_response(report.cases[1].answers[0].train, rpm=speeds)
    swings = response.torque("Welle").half_peak_to_peak
    cell = table.columns[1][table.columns[0].index("Welle")]
    assert float(cell) == pytest.approx(swings.max(), rel=1e-3)


@pytest.mark.slow
def test_the_verdict_names_the_hardest_impact_where_it_is_at_another_mesh(report):
    answer = report.cases[0].answers[2]
    contact = answer.contacts["Kurbel|Räder"]
    assert contact.impacts_per_cycle
    assert "of all" not in verdict(answer)
    longest = dataclasses.replace(contact, separated_fraction=0.5, hardest_impact=0.1)
    elsewhere = dataclasses.replace(contact, separated_fraction=0.1, hardest_impact=0.7)
    contacts = {"Kurbel|Räder": longest, "other": elsewhere}
    topology = SimpleNamespace(mesh_names=tuple(contacts), mesh_backlash=(True, True))
    both = SimpleNamespace(
        topology=topology,
        contacts=contacts,
        at="4000 rpm",
        known=True,
        answered=True,
        doubt="",
        unstable=answer.unstable,
        state=answer.state,
    )
    assert verdict(both).endswith(
        " a cycle, the hardest at 0.10 m/s; hardest impact of all meshes: 0.70"
        " m/s in other."
    )
    contacts["Kurbel|Räder"] = dataclasses.replace(
        longest, impacts_per_cycle=0, hardest_impact=0.0
    )
    assert verdict(both).endswith(
        "50 % of the time, without an impact; hardest impact of all meshes: 0.70"
        " m/s in other."
    )
    contacts["Kurbel|Räder"] = dataclasses.replace(longest, hardest_impact=0.0012)
    contacts["other"] = dataclasses.replace(elsewhere, hardest_impact=0.001)
    assert verdict(both).startswith(
        "The teeth separate and make contact again softly at 4000 rpm: "
    )
    assert verdict(both).endswith(" a cycle, the hardest at 0.0012 m/s.")


@pytest.mark.slow
def test_the_text_has_torques_of_shafts_where_there_are_gears(tmp_path, run):
    (tmp_path / "first.toml").write_text(SCENE, encoding="utf-8")
    completed = run(f"report {tmp_path / 'first.toml'} --rpm 1500")
    completed.check_printed("report_two_cylinders")


@pytest.mark.slow
def test_speeds_that_have_not_converged_are_gaps_with_a_cross_and_do_not_set_the_scale(
    report,
):
    case = report.cases[0]
    answers = [case.answers[0], without_an_answer(case.answers[1]), case.answers[2]]
    good = dataclasses.replace(case, answers=case.answers)
    bad = dataclasses.replace(case, answers=answers)
    converged = float(good.answers[1].force("Kurbel|Räder").peak)
    assert float(bad.answers[1].force("Kurbel|Räder").peak) > 100 * converged
    before = over_speed(forces(report.train), ["Kurbel|Räder"], [good])
    after = over_speed(forces(report.train), ["Kurbel|Räder"], [bad])
    values = after.traces[0]["y"]
    assert values[1] is None
    assert values[::2] == before.traces[0]["y"][::2]
    assert after.panels[0].limits <= before.panels[0].limits
    (crosses,) = [trace for trace in after.traces if trace["name"] == NO_ANSWER]
    assert crosses["x"] == [3000.0]
    assert crosses["y"] == [0.0]
    doubtful = dataclasses.replace(report, cases=[bad])
    parts = {part.title: part for part in parts_of(doubtful, page.PARTS)}
    assert "WITHOUT AN ANSWER" in parts["Result"].html
    note = parts["Notes"].blocks[0]
    assert note.startswith("No result at 3000 rpm with all cylinders firing: Newton")
    assert tables(parts["Accuracy and computed bounds"])[0].columns[1] == ["2 of 3"]
    largest = tables(parts["Tooth forces"])[0]
    row = tables(parts["Motion over the speed"])[0]
    linear_forces = [
        float(answers[place].linear.force("Kurbel|Räder").peak) for place in (0, 2)
    ]
    cell = largest.columns[largest.heads.index("without")][0]
    assert float(cell) == pytest.approx(max(linear_forces) / 1e3, rel=1e-3)
    doubted = [cell.endswith("?") for cell in row.columns[row.heads.index("with kN")]]
    assert doubted == [False, True, False]
    assert row.caption.endswith("?: not converged")


@pytest.mark.slow
def test_linear_speeds_without_an_answer_are_gaps_with_a_cross_too(report, monkeypatch):
    def failing(train, *, rpm):
        response = forced_response(train, rpm=rpm)
        status = np.where(
            np.arange(len(response)) == 3,
            int(Status.MAX_STEPS),
            np.asarray(response.status),
        )
        return dataclasses.replace(response, status=status)

    monkeypatch.setattr(page_parts, "heat_balance", failing)
    # A report of its own, as responses are kept.
    drawn = linear.forced(dataclasses.replace(report))[1]
    assert [i for i, y in enumerate(drawn.traces[0]["y"]) if y is None] == [3]
    assert drawn.traces[-1]["name"] == NO_ANSWER
    assert drawn.traces[-1]["x"] == [drawn.traces[0]["x"][3]]


def unanswered(answer):
    """The same speed with an unknown motion."""
    state = dataclasses.replace(
        answer.state, kind="unknown", period=0, response=None, notes=("it gains speed",)
    )
    return Answer(answer.train, state, answer.linear)


@pytest.mark.slow
def test_a_train_without_a_single_answer_has_a_page_that_says_so(report):
    cases = [
        Case(case.title, [unanswered(answer) for answer in case.answers])
        for case in (*report.cases, report.cases[1])
    ]
    unsolved = dataclasses.replace(report, cases=cases, seconds=[])
    parts = {part.title: part for part in parts_of(unsolved, page.PARTS)}
    assert [title for title, part in parts.items() if part.failed] == []
    assert "No speed has an answer." in parts["Result"].html
    assert "it gains speed" in parts["Notes"].html
    drawn = {title: parts[title] for title in ("Motion over the speed", "Tooth forces")}
    for figure in figures(drawn):
        for trace in figure.traces:
            if trace["name"] == "all cylinders firing":
                assert all(y is None for y in trace["y"])


@pytest.mark.slow
def test_a_part_that_fails_is_a_sentence_leaves_the_others_and_exits_1(
    page_file, capsys, monkeypatch
):
    def broken(_):
        raise KeyError("no such thing")

    monkeypatch.setattr(page, "PARTS", page.PARTS | {"Limits": broken})
    file = page_file.with_name("part.html")
    scene = str(page_file.parent / "first.toml")
    assert main(["report", scene, "--rpm", "1500", "--html", str(file)]) == 1
    text = file.read_text(encoding="utf-8")
    assert "This part could not be made: KeyError: " in text
    assert "&ensp;Accuracy and computed bounds</h2>" in text
    # The command names no second design.
    assert "Second design" not in text
    assert (
        "--html: 'Limits' is missing from the page: KeyError" in capsys.readouterr().err
    )


@pytest.mark.slow
def test_heads_of_groups_stand_above_their_columns(page_file):
    rows = re.findall(
        r"<tr>(<th colspan.*?)</tr>\s*<tr>(.*?)</tr>",
        page_file.read_text(encoding="utf-8"),
        re.DOTALL,
    )
    wide = [
        [int(n) for n in re.findall(r'colspan="(\d+)"', groups)] for groups, _ in rows
    ]
    assert len(wide) > 10
    for row, (_, heads) in zip(wide, rows, strict=True):
        assert sum(row) <= heads.count("</th>")
    shares = next(groups for groups, heads in rows if ">judged<" in heads)
    assert re.findall(r'colspan="(\d+)"[^>]*>([^<]*)', shares)[:2] == [
        ("3", ""),
        ("2", "first design"),
    ]


@pytest.mark.slow
def test_plotly_knows_every_key_of_every_figure(parts):
    graph_objects = pytest.importorskip("plotly.graph_objects")
    for figure in figures(parts):
        graph_objects.Figure({"data": figure.traces, "layout": layout_of(figure)})


@pytest.mark.slow
def test_lines_differ_without_colour(parts):
    for figure in figures(parts):
        lines = [
            trace
            for trace in figure.traces
            if "lines" in trace["mode"] and trace.get("showlegend", True)
        ]
        looks = [
            (
                trace["yaxis"],
                trace["line"].get("dash"),
                trace.get("marker", {}).get("symbol", [""])[0],
            )
            for trace in lines
        ]
        assert len(set(looks)) == len(looks), figure.caption


@pytest.mark.slow
def test_the_page_escapes_names_and_forbids_the_browser_to_load_anything(
    page_file, parts
):
    text = page_file.read_text(encoding="utf-8")
    (policy,) = re.findall(r'Content-Security-Policy" content="([^"]*)"', text)
    assert policy.startswith("default-src 'none';")
    assert "http" not in policy
    assert "<h1>Prüfstand &lt;Süd&gt; &amp; Nord</h1>" in text
    outside = re.sub(r"<script>.*?</script>|<svg.*?</svg>", "", text, flags=re.DOTALL)
    assert not re.search(r"(src|href)\s*=\s*[\"']?(https?:)?//|@import|url\(", outside)
    numbers = re.findall(r'<script type="application/json">(.*?)</script>', text)
    traces = [json.loads(record)["data"] for record in numbers]
    assert traces == [figure.traces for figure in figures(parts)]


@pytest.mark.slow
@pytest.mark.skipif(
    CHROMIUM is None, reason="no chromium is installed: apt-get install chromium"
)
def test_a_browser_draws_every_figure_without_a_network_or_an_error(page_file, parts):
    text = page_file.read_text(encoding="utf-8").replace(
        "</body>", f"<script>{WIDE}</script></body>"
    )
    page_file.with_stem("measured").write_text(text, encoding="utf-8")
    page_file.with_stem("wider").write_text(
        text.replace("</head>", f"{WIDER}</head>"), encoding="utf-8"
    )
    completed = browse(page_file.with_stem("measured"), "--dump-dom")
    assert [line for line in completed.stderr.splitlines() if "CONSOLE" in line] == []
    expected = [
        sum(any(y is not None for y in trace["y"]) for trace in figure.traces)
        for figure in figures(parts)
    ]
    document = completed.stdout
    assert re.findall(r'data-figures="(\d+)"', document) == [str(len(expected))]
    counts = re.findall(r'class="plot[^>]*data-traces="(\d+)"', document)
    assert [int(count) for count in counts] == expected
    assert re.findall(r'data-wide="(.*?)"', document) == [""]
    # Tables fit the sheet whatever the fonts of a machine.
    wider = browse(page_file.with_stem("wider"), "--dump-dom").stdout
    assert re.findall(r'data-wide="(.*?)"', wider) == [""]
