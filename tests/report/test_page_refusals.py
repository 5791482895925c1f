"""What a page of ``jaxhb report --html`` advises, and what it says where it, or a part of it, cannot be made."""

import re
from types import SimpleNamespace

import pytest

import jaxhb
from jaxhb.cli import page_command
from jaxhb.cli.main import main
from jaxhb.report.answer import Case
from jaxhb.report.page.page import parts_of
from jaxhb.report.page.parts import Report
from jaxhb.report.page.train import assumptions


def test_what_the_assumptions_advise_keeps_the_compression_of_a_cylinder():
    row = {"disk": "a", "bore": 0.1, "stroke": 0.1, "rod": 0.2, "name": "x"}
    given = {"compression_ratio": 16.0, "charge_pressure": 2e5, "start": -5.0, "duration": 60.0}
    for by, much in (("imep", 1e6), ("heat", 2000.0)):
        parts = [
            jaxhb.Disk(name="a", inertia=1.0, damping=1.0),
            jaxhb.Disk(name="b", inertia=1.0),
            jaxhb.Load(disk="b"),
        ]
        parts += [jaxhb.Shaft(between=("a", "b"), stiffness=1e4)]
        parts += [jaxhb.Cylinder(**row, combustion=jaxhb.Combustion(**given, **{by: much}))]
        train = jaxhb.build(parts, revolutions_per_cycle=2)
        report = Report([Case("", [SimpleNamespace(train=train, orbit=False)])], facts={"date": "today"})
        (part,) = parts_of(report, {"": ("assumptions", assumptions)})
        (key,) = re.findall(r"--set &#34;(.*)=0&#34;", part.html)
        swings = [
            float(jaxhb.forced_response(one, rpm=1000.0).torque("a|b").half_peak_to_peak)
            for one in (train, train.replace({key: 0.0}), train.misfire("x"))
        ]
        assert swings[0] > 1.05 * swings[1] and swings[1] > 10.0 and swings[2] < 1e-9


WRONG = {
    "another ending": (["--html", "page.txt"], "Give a name that ends in .html."),
    "a second design without a page": (["--tuned", "spur_pair"], "Add --html FILE.html."),
    "a second design that is not there": (["--html", "page.html", "--tuned", "no.toml"], "there is no such file"),
    "nothing to tune": (["--html", "page.html", "--tune"], "the scene has no [tune] table"),
    "two second designs": (["--html", "page.html", "--tune", "--tuned", "a.toml"], "--tune exclude each other"),
    "one file for two": (["--html", "page.html", "--json", "page.html"], "name the same file"),
}


@pytest.mark.parametrize(("options", "sentence"), WRONG.values(), ids=WRONG)
def test_what_no_page_can_tell_is_refused_before_anything_is_computed(options, sentence, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert main(["report", "spur_pair", "--rpm", "2000", *options]) == 2
    said = capsys.readouterr()
    assert sentence in said.err and said.out == ""
    assert not list(tmp_path.iterdir())


def test_a_page_without_its_libraries_says_what_to_install(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr(page_command, "NEEDED", ("jinja2", "plotly_of_another_planet"))
    assert main(["report", "spur_pair", "--rpm", "2000", "--html", str(tmp_path / "page.html")]) == 2
    assert 'needs plotly_of_another_planet. Install it: pip install "jaxhb[report]".' in capsys.readouterr().err
