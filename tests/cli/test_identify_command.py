"""``jaxhb identify``: tables, files, the fitted scene, the weak cylinder."""

import numpy as np
import pytest
from reference_data import reference

import jaxhb


@pytest.fixture
def measured(tmp_path):
    """Orders of the diesel with a softer shaft and a cylinder with less gas torque."""
    return written(
        tmp_path, {"cyl6|flywheel.stiffness": 1.8e6, "cylinder 4.gas_factor": 0.8}
    )


def written(folder, differences):
    """A file of orders of the diesel with numbers of its own."""
    truth = jaxhb.load_scene("six_cylinder_diesel").replace(differences)
    lines = ["rpm,order,element,quantity,amplitude,phase"]
    for rpm in (1500.0, 1900.0, 2200.0):
        speed = jaxhb.forced_response(truth, rpm=rpm).speed("flywheel")
        for order in (0.5, 1.5, 3.0, 6.0):
            c = 2 * complex(np.asarray(speed.coefficients)[round(2 * order)])
            lines.append(
                f"{rpm},{order},flywheel,speed,{abs(c):.12g},{np.rad2deg(np.angle(c)):.12g}"
            )
    path = folder / "measured.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


@pytest.mark.slow
def test_the_fitted_scene_loads_with_its_numbers_and_tolerances(
    measured, tmp_path, run
):
    line = (
        '--fit "cyl6|flywheel.stiffness=1e6:4e6" --fit "cylinder 4.gas_factor=0.5:1.2"'
    )
    fitted = tmp_path / "out" / "fitted.toml"
    fitted.parent.mkdir()
    called = run(
        f"identify six_cylinder_diesel {measured} {line} --output {fitted}",
        "json",
        "plot",
    )
    assert called.status == 0 and called.is_drawn
    train = jaxhb.load_scene(fitted)
    assert train.value("cyl6|flywheel.stiffness") == pytest.approx(1.8e6, rel=1e-4)
    assert train.value("cylinder 4.gas_factor") == pytest.approx(0.8, rel=1e-4)
    first = called.json["parameters"][0]
    assert train.tolerance["cyl6|flywheel.stiffness"]["std"] == pytest.approx(
        first["std"], rel=1e-3
    )
    assert len(called.json["rows"]) == 12 and called.json["misfit"] < 0.1
    assert "cyl6|flywheel.stiffness" in called.out


@pytest.mark.slow
@pytest.mark.parametrize("burnt", [0.8, 0.0])
def test_the_weak_cylinder_is_told_and_how_much_it_burns(tmp_path, run, burnt):
    """Less injection, down to a misfire: compression stays."""
    measured = written(tmp_path, {"cylinder 4.injection": burnt})
    called = run(f"identify six_cylinder_diesel {measured} --weak-cylinder", "json")
    assert called.status == 0 and called.out.startswith(
        f"cylinder 4 burns {100 * burnt:.0f} % of what the others do."
    )
    first = called.json["weak_cylinder"][0]
    assert first["name"] == "cylinder 4" and first["gas_factor"] == pytest.approx(
        burnt, abs=1e-3
    )
    assert called.json["explains"]


@pytest.mark.slow
def test_no_cylinder_is_blamed_for_what_another_number_of_the_scene_does(tmp_path, run):
    # All cylinders fire alike with twice the gas torque that the scene has: one alone
    # that differs explains nothing.
    train = jaxhb.load_scene("six_cylinder_diesel")
    truth = train.replace(
        {f"{name}.gas_factor": 2.0 for name in train.topology.cylinders.names}
    )
    lines = ["rpm,order,element,quantity,amplitude,phase"]
    for rpm in (1500.0, 1900.0):
        torque = 2 * np.asarray(
            jaxhb.forced_response(truth, rpm=rpm).torque("cyl6|flywheel").coefficients
        )
        for c, order in ((torque[6], 3.0), (torque[12], 6.0), (torque[9], 4.5)):
            lines.append(
                f"{rpm},{order},cyl6|flywheel,torque,{abs(c)},{np.rad2deg(np.angle(c))}"
            )
    path = tmp_path / "measured.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    called = run(f"identify six_cylinder_diesel {path} --weak-cylinder", "json")
    assert called.status == 1 and called.out.startswith(
        "No verdict: no cylinder that alone differs explains"
    )
    assert (
        called.json["misfit"] > 2
        and not called.json["explains"]
        and "at its bound" in called.out
    )
    # What is told of each is as uncertain as its fit is bad: without the misfit the
    # deviation is below 1 %.
    assert all(one["std"] > 0.02 for one in called.json["weak_cylinder"])


@pytest.mark.parametrize(("line", "sentence"), reference("cases")["identifications"])
def test_what_cannot_be_asked_is_refused_in_a_sentence(measured, run, line, sentence):
    called = run(f"identify six_cylinder_diesel {measured} {line}")
    assert called.status == 2 and sentence in called.err
