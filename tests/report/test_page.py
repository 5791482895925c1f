"""The page of ``jaxhb report --html``: what it tells, in plain Python, and how a
browser draws it without a network.
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
from jaxhb.report.figures.speeds import over_speed
from jaxhb.report.page import linear, page
from jaxhb.report.page.judgement import shares_of
from jaxhb.report.page.page import parts_of
from jaxhb.report.quantities import forces
from jaxhb.report.text.columns import Table
from jaxhb.report.text.sentences import verdict
from jaxhb.results.status import Status

SPEEDS = "1500,3000,4000"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A page from the command line, in a folder with blanks and umlauts: its file, the
    report and its parts.
    """
    folder = tmp_path_factory.mktemp("Prüfstand 2 – größer")
    kept = []
    (folder / "first.toml").write_text(SCENE, encoding="utf-8")
    other = SCENE.replace("damping = 5.0, power", "damping = 25.0, power")
    (folder / "second.toml").write_text(other, encoding="utf-8")
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
    ]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            page,
            "parts_of",
            lambda *given: kept.append((given[0], parts_of(*given))) or kept[-1][1],
        )
        assert main([*command, "--tuned", str(folder / "second.toml")]) == 0
    ((report, parts),) = kept
    return file, report, {part.title: part for part in parts}


def test_every_part_of_the_report_is_there(made):
    _, _, parts = made
    asked = [
        title for title in page.PARTS if title != "Tolerances"
    ]  # has a test of its own, with the command
    assert list(parts) == asked
    assert [title for title, part in parts.items() if part.failed] == []
    undrawn = [title for title, part in parts.items() if not figures({title: part})]
    words = [
        "Result",
        "Train and data",
        "Assumptions and versions",
        "Accuracy and computed bounds",
        "Notes",
    ]
    assert undrawn == words
    assert "<svg" in parts["Train and data"].html


def test_tables_tell_the_numbers_of_the_answers(made):
    _, report, parts = made
    normal, misfire = report.cases
    table = tables(parts["Torques of shafts and dampers"])[0]
    assert [title for title, *_ in table.groups] == [
        "all cylinders firing",
        "two not firing",
    ]
    row = table.columns[0].index("Welle")
    for case, first in ((normal, 1), (misfire, 5)):
        swings = [
            float(answer.torque("Welle").half_peak_to_peak) for answer in case.answers
        ]
        assert float(table.columns[first][row]) == pytest.approx(max(swings), rel=1e-3)
        assert (
            table.columns[first + 1][row] == f"{report.rpm[int(np.argmax(swings))]:g}"
        )
    heat = tables(parts["Heat of dampers"])[0]
    assert heat.columns[0] == ["Dämpfer"]
    assert float(heat.columns[1][0]) > 0


def test_irregularity_of_the_heaviest_disk_the_gears_and_the_loads_is_in_per_cent_in_all_tables(
    made,
):
    _, report, parts = made
    normal = report.cases[0].answers
    disks = ["Kurbel", "Räder", "Bremse"]
    over, _, largest = tables(parts["Motion over the speed"])[-3:]
    assert list(largest.columns[0]) == disks
    for first, case in ((1, report.cases[0]), (5, report.cases[1])):
        wanted = [
            100 * max(answer.irregularity(disk) for answer in case.answers)
            for disk in disks
        ]
        assert [float(cell) for cell in largest.columns[first]] == pytest.approx(
            wanted, rel=2e-3
        )
    one = next(
        table
        for table in tables(parts["One speed in full"])
        if "irregularity" in table.title
    )
    assert (over.heads[1], over.groups[0]) == ("Kurbel", ("irregularity, %", 1, 1))
    wanted = [a.irregularity("Kurbel") for a in normal] + [
        normal[report.place].irregularity(disk) for disk in disks
    ]
    assert [
        float(cell) / 100 for cell in (*over.columns[1], *one.columns[1][:3])
    ] == pytest.approx(wanted, rel=6e-3)


def test_the_second_design_stands_beside_the_first_with_what_differs(made):
    _, report, parts = made
    differ, forces_of_both, *_ = tables(parts["Second design"])
    assert [column[0] for column in differ.columns] == [
        "Dämpfer.damping",
        "5",
        "25",
        "N m s/rad",
    ]
    assert len(differ.columns[0]) == 1
    assert [title for title, *_ in forces_of_both.groups] == [
        "first design",
        "second design (second)",
    ]
    largest = max(
        float(answer.force("Kurbel|Räder").peak) for answer in report.seconds[0].answers
    )
    assert float(forces_of_both.columns[7][0]) == pytest.approx(largest / 1e3, rel=1e-3)


def test_the_result_judges_every_case_and_names_limit_element_case_and_speed_the_largest_share_first(
    made,
):
    _, report, parts = made
    found = list(shares_of(report.cases).values())
    shares = [one.share for one in found]
    assert len(shares) == 3
    assert shares == sorted(shares, reverse=True)
    reads = {"Dämpfer": lambda a: a.power("Dämpfer") / 500.0}
    reads["Kurbel|Räder"] = lambda a: (
        0.05 * float(a.force("Kurbel|Räder").half_peak_to_peak) / 300.0
    )
    for name, read in reads.items():
        share, case, rpm = max(
            (read(a), case.title, a.rpm) for case in report.cases for a in case.answers
        )
        (one,) = [one for one in found if one.name == name]
        assert (one.case, one.rpm) == (case, rpm)
        assert one.share == pytest.approx(share, rel=1e-9)
        assert f"{one.kind.called} of {name} {share:.2f} of " in parts["Result"].html
    assert "of a third of the rated torque (" in parts["Result"].html
    assert "of its limit (" in parts["Result"].html


def test_the_second_design_has_its_limits_its_heat_and_the_misfire(made):
    _, report, parts = made
    heat = next(
        table
        for table in tables(parts["Second design"])
        if table.title.startswith("Heat of dampers")
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
    assert float(
        shares.columns[5][shares.columns[0].index("Dämpfer")]
    ) == pytest.approx(largest / 500.0, abs=0.006)
    misfiring = report.seconds[1].answers[0].train
    assert misfiring.topology.cylinder_fires == (True, False)
    assert misfiring.value("Dämpfer.damping") == 25.0
    assert "was run without a misfire" not in parts["Second design"].html
    told = second_text(report.cases, report.seconds).splitlines()
    both = report.seconds[0], report.cases[0]
    force, first = (
        max(float(a.force("Kurbel|Räder").peak) for a in case.answers) for case in both
    )
    assert told[0].startswith(
        f"The {second}: largest tooth force {force / 1e3:.4g} kN in Kurbel|Räder at "
    )
    assert told[0].endswith(f" rpm ({100 * (force / first - 1):+.1f} %).")
    assert "two not firing" in told[1]


def test_a_second_design_without_the_cylinder_is_told_as_run_without_a_misfire(made):
    _, report, _ = made
    alone = dataclasses.replace(report, seconds=report.seconds[:1])
    (part,) = parts_of(alone, {"Second design": page.PARTS["Second design"]})
    assert (
        "The second design was run without a misfire: nothing here shows what a misfire"
        " does to it." in part.html
    )


def test_the_linear_parts_name_their_case_and_tell_the_misfire_too(made):
    _, report, parts = made
    campbell = parts["Campbell diagram and critical speeds"]
    forced = parts["Linear forced response"]
    (diagram,) = figures({"": campbell})
    assert diagram.caption.startswith("Campbell diagram, all cylinders firing: ")
    critical = tables(campbell)[1]
    assert critical.heads[-3:] == ["modal torque N m", "worst misfire N m", "that of"]
    assert set(critical.columns[-1]) == {"two"}
    one = critical.columns[1].index("1")  # both act alike: half is left
    assert float(critical.columns[-2][one]) == pytest.approx(
        float(critical.columns[-3][one]) / 2, rel=0.01
    )
    for figure in figures({"": forced}):
        assert "over the speed, all cylinders firing, " in figure.caption
    worst = blocks(
        forced.blocks[forced.blocks.index("Largest values, two not firing") :], Table
    )
    table = next(table for table in worst if "Welle" in table.columns[0])
    speeds = np.unique([*report.rpm, *np.linspace(1500, 4000, linear.SPEEDS)])
    swings = (
        forced_response(report.cases[1].answers[0].train, rpm=speeds)
        .torque("Welle")
        .half_peak_to_peak
    )
    assert float(table.columns[1][table.columns[0].index("Welle")]) == pytest.approx(
        swings.max(), rel=1e-3
    )


def test_the_verdict_names_the_hardest_impact_of_all_where_it_is_at_another_mesh(made):
    answer = made[1].cases[0].answers[2]
    own = answer.contacts["Kurbel|Räder"]
    other = dataclasses.replace
    assert own.impacts_per_cycle
    assert "of all" not in verdict(answer)
    longest = other(own, separated_fraction=0.5, hardest_impact=0.1)
    elsewhere = other(own, separated_fraction=0.1, hardest_impact=0.7)
    told = {"Kurbel|Räder": longest, "other": elsewhere}
    train = SimpleNamespace(mesh_names=tuple(told), mesh_backlash=(True, True))
    both = SimpleNamespace(
        topology=train,
        contacts=told,
        at="4000 rpm",
        known=True,
        answered=True,
        doubt="",
    )
    both.unstable = answer.unstable
    both.state = answer.state
    assert verdict(both).endswith(
        " a cycle, the hardest at 0.10 m/s; the hardest of all at 0.70 m/s in other."
    )
    told["Kurbel|Räder"] = other(longest, impacts_per_cycle=0, hardest_impact=0.0)
    assert verdict(both).endswith(
        "50 % of the time, without an impact; the hardest of all at 0.70 m/s in other."
    )
    told |= {
        "Kurbel|Räder": other(longest, hardest_impact=0.0012),
        "other": other(elsewhere, hardest_impact=0.001),
    }
    assert verdict(both).startswith(
        "The teeth part and touch again softly at 4000 rpm: "
    )
    assert verdict(both).endswith(" a cycle, the hardest at 0.0012 m/s.")


def test_the_text_tells_torques_of_shafts_where_there_are_gears(made, capsys):
    file, _, _ = made
    assert main(["report", str(file.parent / "first.toml"), "--rpm", "1500"]) == 0
    said = capsys.readouterr().out
    assert "Gear torque, half peak-to-peak" in said
    table = said[said.index("Torque of shafts and dampers, half peak-to-peak, N m") :]
    assert re.search(r"\n  Welle +[\d.]+ +[\d.]+ +[\d.]+\n", table)


def test_speeds_that_have_not_converged_are_gaps_with_a_cross_and_do_not_set_the_scale(
    made,
):
    _, report, _ = made
    case = report.cases[0]
    answers = [case.answers[0], without_an_answer(case.answers[1]), case.answers[2]]
    good, bad = (
        dataclasses.replace(case, answers=chosen) for chosen in (case.answers, answers)
    )
    assert float(bad.answers[1].force("Kurbel|Räder").peak) > 100 * float(
        good.answers[1].force("Kurbel|Räder").peak
    )
    before, after = (
        over_speed(forces(report.train), ["Kurbel|Räder"], [one]) for one in (good, bad)
    )
    values = after.traces[0]["y"]
    assert values[1] is None
    assert values[::2] == before.traces[0]["y"][::2]
    assert after.layout["yaxis"]["range"][1] <= before.layout["yaxis"]["range"][1]
    (crosses,) = [trace for trace in after.traces if trace["name"] == NO_ANSWER]
    assert crosses["x"] == [3000.0]
    assert crosses["y"] == [0.0]
    parts = {
        part.title: part
        for part in parts_of(dataclasses.replace(report, cases=[bad]), page.PARTS)
    }
    assert "WITHOUT AN ANSWER" in parts["Result"].html
    assert "MAX_STEPS" in parts["Notes"].html
    assert tables(parts["Accuracy and computed bounds"])[0].columns[1] == ["2 of 3"]
    largest = tables(parts["Tooth forces"])[0]
    row = tables(parts["Motion over the speed"])[0]
    without = (
        max(float(answers[i].linear.force("Kurbel|Räder").peak) for i in (0, 2)) / 1e3
    )
    assert float(largest.columns[largest.heads.index("without")][0]) == pytest.approx(
        without, rel=1e-3
    )
    doubted = [cell.endswith("?") for cell in row.columns[row.heads.index("with kN")]]
    assert doubted == [False, True, False]
    assert row.title.endswith("?: not converged")


def test_linear_speeds_without_an_answer_are_gaps_with_a_cross_too(made, monkeypatch):
    _, report, _ = made

    def failing(train, *, rpm):
        found = forced_response(train, rpm=rpm)
        status = np.where(
            np.arange(len(found)) == 3, int(Status.MAX_STEPS), np.asarray(found.status)
        )
        return dataclasses.replace(found, status=status)

    monkeypatch.setattr(linear, "forced_response", failing)
    drawn = linear.forced(report)[1]
    assert [i for i, y in enumerate(drawn.traces[0]["y"]) if y is None] == [3]
    assert drawn.traces[-1]["name"] == NO_ANSWER
    assert drawn.traces[-1]["x"] == [drawn.traces[0]["x"][3]]


def test_a_train_without_a_single_answer_has_a_page_that_says_so(made):
    _, report, _ = made
    nothing = {
        "kind": "unknown",
        "period": 0,
        "response": None,
        "notes": ("it gains speed",),
    }
    cases = [
        Case(
            case.title,
            [
                Answer(a.train, dataclasses.replace(a.state, **nothing), a.linear)
                for a in case.answers
            ],
        )
        for case in (*report.cases, report.cases[1])
    ]
    alone = dataclasses.replace(report, cases=cases, seconds=[])
    parts = {part.title: part for part in parts_of(alone, page.PARTS)}
    assert [title for title, part in parts.items() if part.failed] == []
    assert "No speed has an answer." in parts["Result"].html
    assert "it gains speed" in parts["Notes"].html
    for figure in figures(
        {title: parts[title] for title in ("Motion over the speed", "Tooth forces")}
    ):
        assert all(
            y is None
            for trace in figure.traces
            if trace["name"] == "all cylinders firing"
            for y in trace["y"]
        )


def test_a_part_that_fails_is_a_sentence_leaves_the_others_and_exits_1(
    made, capsys, monkeypatch
):
    def broken(_):
        raise KeyError("no such thing")

    monkeypatch.setattr(page, "PARTS", page.PARTS | {"Limits": broken})
    file = made[0].with_name("part.html")
    assert (
        main(
            [
                "report",
                str(made[0].parent / "first.toml"),
                "--rpm",
                "1500",
                "--html",
                str(file),
            ]
        )
        == 1
    )
    text = file.read_text(encoding="utf-8")
    assert "This part could not be made: KeyError: " in text
    assert "&ensp;Accuracy and computed bounds</h2>" in text
    assert "Second design" not in text  # no second design was asked for
    assert (
        "--html: 'Limits' is missing from the page: KeyError" in capsys.readouterr().err
    )


def test_heads_of_groups_stand_above_their_columns(made):
    rows = re.findall(
        r"<tr>(<th colspan.*?)</tr>\s*<tr>(.*?)</tr>",
        made[0].read_text(encoding="utf-8"),
        re.DOTALL,
    )
    wide = [
        [int(n) for n in re.findall(r'colspan="(\d+)"', groups)] for groups, _ in rows
    ]
    assert len(wide) > 10
    assert all(
        sum(row) <= heads.count("</th>")
        for row, (_, heads) in zip(wide, rows, strict=True)
    )
    shares = next(row for row in rows if ">judged<" in row[1])[0]
    assert re.findall(r'colspan="(\d+)"[^>]*>([^<]*)', shares)[:2] == [
        ("3", ""),
        ("2", "first design"),
    ]


def test_plotly_knows_every_key_of_every_figure(made):
    graph_objects = pytest.importorskip("plotly.graph_objects")
    for figure in figures(made[2]):
        graph_objects.Figure({"data": figure.traces, "layout": figure.layout})


def test_lines_differ_without_colour(made):
    for figure in figures(made[2]):
        lines = [
            trace
            for trace in figure.traces
            if "lines" in trace["mode"] and trace.get("showlegend", True)
        ]
        looks = [
            (
                t["yaxis"],
                t["line"].get("dash"),
                t.get("marker", {}).get("symbol", [""])[0],
            )
            for t in lines
        ]
        assert len(set(looks)) == len(looks), figure.caption


def test_the_page_escapes_names_and_forbids_the_browser_to_load_anything(made):
    text = made[0].read_text(encoding="utf-8")
    (policy,) = re.findall(r'Content-Security-Policy" content="([^"]*)"', text)
    assert policy.startswith("default-src 'none';")
    assert "http" not in policy
    assert "<h1>Prüfstand &lt;Süd&gt; &amp; Nord</h1>" in text
    outside = re.sub(r"<script>.*?</script>|<svg.*?</svg>", "", text, flags=re.DOTALL)
    assert not re.search(r"(src|href)\s*=\s*[\"']?(https?:)?//|@import|url\(", outside)
    numbers = re.findall(r'<script type="application/json">(.*?)</script>', text)
    assert [json.loads(one)["data"] for one in numbers] == [
        figure.traces for figure in figures(made[2])
    ]


@pytest.mark.skipif(
    CHROMIUM is None, reason="no chromium is installed: apt-get install chromium"
)
def test_a_browser_draws_every_figure_without_a_network_or_an_error(made):
    file, _, parts = made
    text = file.read_text(encoding="utf-8").replace(
        "</body>", f"<script>{WIDE}</script></body>"
    )
    file.with_stem("measured").write_text(text, encoding="utf-8")
    file.with_stem("wider").write_text(
        text.replace("</head>", f"{WIDER}</head>"), encoding="utf-8"
    )
    done = browse(file.with_stem("measured"), "--dump-dom")
    assert [line for line in done.stderr.splitlines() if "CONSOLE" in line] == []
    wanted = [
        sum(any(y is not None for y in trace["y"]) for trace in figure.traces)
        for figure in figures(parts)
    ]
    assert re.findall(r'data-figures="(\d+)"', done.stdout) == [str(len(wanted))]
    drawn = [
        int(count)
        for count in re.findall(r'class="plot[^>]*data-traces="(\d+)"', done.stdout)
    ]
    assert drawn == wanted
    assert re.findall(r'data-wide="(.*?)"', done.stdout) == [""]
    # Tables fit the sheet whatever the fonts of a machine.
    wider = browse(file.with_stem("wider"), "--dump-dom").stdout
    assert re.findall(r'data-wide="(.*?)"', wider) == [""]
