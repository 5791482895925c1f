"""Campaigns: rows beside closed forms and single solves, and nothing lost whatever
happens.
"""

import dataclasses
import errno
import os
import subprocess
import sys
from concurrent.futures import Executor, Future, ThreadPoolExecutor

import numpy as np
import pytest

import jaxhb
from jaxhb import Disk, Shaft, Torque
from jaxhb.results.checkpoint import CheckpointError
from jaxhb.studies import folder as campaign_folder, rows as campaign_rows
from jaxhb.studies.campaign import CampaignSummary
from jaxhb.studies.study import Change, Study, Variant, load_study

pandas = pytest.importorskip("pandas")
pytest.importorskip("pyarrow")

DRIVE = 5.0  # N m
SPEEDS = [900.0, 955.0, 1200.0, 1500.0]
STIFFNESSES = [6.0e3, 6.7e3, 7.4e3]
DAMPINGS = [2.0, 4.0]
CAMPAIGN = [sys.executable, "-m", "jaxhb.cli.main", "campaign"]
TORQUE = "shaft torque of a|b [N m]"


@pytest.fixture
def study_file(tmp_path):
    """A study of two disks on a shaft: 3 stiffnesses, 2 dampings, 4 speeds."""
    parts = [Disk(name="a", inertia=1.0), Disk(name="b", inertia=2.0)]
    parts += [Shaft(between=("a", "b"), stiffness=6.7e3, damping=4.0)]
    parts += [Torque(disk="a", harmonics=[(1.0, DRIVE, 0.0)])]
    scene = jaxhb.elements_text(parts, name="pair", revolutions_per_cycle=1)
    (tmp_path / "pair.toml").write_text(scene)
    file = tmp_path / "shafts.toml"
    file.write_text(f"""
        scene = "pair.toml"
        rpm = {SPEEDS}
        keep = ["shaft torque of a|b"]
        part = 3
        [[change]]
        name = "a|b.stiffness"
        values = {STIFFNESSES}
        [[change]]
        name = "a|b.damping"
        values = {DAMPINGS}
    """)
    return file


def rows_in(folder):
    """All rows of a campaign in the order of their cases."""
    rows = pandas.read_parquet(folder / "rows")
    return rows.sort_values("case", ignore_index=True)


def exact_torque(rpm, stiffness, damping):
    """Amplitude of the torque of the shaft: one equation of the twist."""
    omega = np.pi / 30 * rpm
    reduced = 2 / 3
    link = stiffness + 1j * omega * damping
    return np.abs(link * (DRIVE / 1.0) / (link / reduced - omega**2))


@pytest.mark.parametrize("answers", ["steady", "orbit", "forced"])
def test_rows_are_those_of_the_closed_form(tmp_path, study_file, answers):
    study_file.write_text(f'answers = "{answers}"\n{study_file.read_text()}')
    summary = jaxhb.campaign(study_file, folder=tmp_path / "out")
    rows = rows_in(tmp_path / "out")
    assert summary.cases == len(rows) == 3 * 2 * 4
    assert rows["case"].tolist() == list(range(len(rows)))
    assert rows["rpm"].tolist() == SPEEDS * 6
    assert rows["a|b.stiffness"].tolist() == np.repeat(STIFFNESSES, 8).tolist()
    assert rows["a|b.damping"].tolist() == np.tile(np.repeat(DAMPINGS, 4), 3).tolist()
    expected = exact_torque(rows["rpm"], rows["a|b.stiffness"], rows["a|b.damping"])
    # Extremes over 4096 time samples lie below the amplitude by up to 3e-7.
    np.testing.assert_allclose(rows[TORQUE], expected, rtol=1e-6)
    assert set(rows["kind"]) == {"periodic"}
    assert set(rows["status"]) == {"CONVERGED"}
    assert set(rows["problem"]) == {""}
    largest = summary.largest[TORQUE]
    place = int(np.argmax(expected))
    assert (largest.case, largest.rpm) == (place, rows["rpm"][place])
    stiffness = rows["a|b.stiffness"][place]
    assert largest.train["a|b.stiffness"] == stiffness


def test_rows_do_not_depend_on_the_executor(tmp_path, study_file):
    jaxhb.campaign(study_file, folder=tmp_path / "alone")
    with ThreadPoolExecutor(3) as threads:
        jaxhb.campaign(study_file, folder=tmp_path / "threads", executor=threads)
    assert rows_in(tmp_path / "threads").equals(rows_in(tmp_path / "alone"))


@pytest.mark.slow
def test_rows_of_hammering_teeth_are_the_same_bits_from_workers(tmp_path):
    file = tmp_path / "pair.toml"
    file.write_text("""
        scene = "spur_pair"
        rpm = "1000:6000:12"
        keep = ["tooth force of gear a|gear b", "impact severity of gear a|gear b"]
        part = 4
        [[change]]
        name = "gear a|gear b.backlash"
        values = [1e-4, 1.2e-4]
    """)
    # Programs of this process are compiled otherwise than those of others.
    command = [*CAMPAIGN, str(file), "--quiet", "--out"]
    subprocess.run([*command, str(tmp_path / "alone")], check=True)
    subprocess.run([*command, str(tmp_path / "workers"), "--workers", "2"], check=True)
    rows = rows_in(tmp_path / "workers")
    assert rows.equals(rows_in(tmp_path / "alone"))
    assert {"contact", "periodic"} <= set(rows["kind"])
    train = jaxhb.load_scene("spur_pair").replace({"gear a|gear b.backlash": 1.2e-4})
    row = rows[(rows["case"] >= 12) & (rows["kind"] == "periodic")].iloc[0]
    state = jaxhb.steady_state(train, rpm=row["rpm"])
    force = state.force("gear a", "gear b").half_peak_to_peak
    assert row["tooth force of gear a|gear b [N]"] == pytest.approx(force, rel=1e-9)


def test_a_campaign_goes_on_where_it_was_stopped(tmp_path, study_file):
    jaxhb.campaign(study_file, folder=tmp_path / "whole")
    folder = tmp_path / "stopped"

    def stop(count, done=[]):  # noqa: B006
        done.append(count)
        if sum(done) >= 10:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        jaxhb.campaign(study_file, folder=folder, progress=stop)
    done = rows_in(folder)
    assert 10 <= len(done) < 24
    counts = []
    jaxhb.campaign(study_file, folder=folder, progress=counts.append)
    assert counts[0] == len(done)
    assert sum(counts) == 24
    assert rows_in(folder).equals(rows_in(tmp_path / "whole"))


def test_a_full_disk_stops_a_campaign_that_then_goes_on(
    tmp_path, study_file, monkeypatch
):
    jaxhb.campaign(study_file, folder=tmp_path / "whole")
    write = campaign_folder.write_whole
    written = []

    def full(contents):
        if len(written) == 4:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        written.append(contents)
        write(contents)

    monkeypatch.setattr(campaign_folder, "write_whole", full)
    with pytest.raises(CheckpointError, match="No space left .* campaign goes on"):
        jaxhb.campaign(study_file, folder=tmp_path / "full")
    monkeypatch.undo()
    jaxhb.campaign(study_file, folder=tmp_path / "full")
    assert rows_in(tmp_path / "full").equals(rows_in(tmp_path / "whole"))


def test_a_folder_of_another_campaign_is_refused(tmp_path, study_file):
    jaxhb.campaign(study_file, folder=tmp_path / "out")
    study_file.write_text(study_file.read_text().replace("[2.0, 4.0]", "[2.0, 4.1]"))
    with pytest.raises(CheckpointError, match="other numbers: changes"):
        jaxhb.campaign(study_file, folder=tmp_path / "out")
    (tmp_path / "out" / "campaign.json").write_text("nothing")
    with pytest.raises(CheckpointError, match="no readable campaign.json"):
        jaxhb.campaign(study_file, folder=tmp_path / "out")


def test_a_train_that_is_refused_is_rows_with_its_sentence(tmp_path, study_file):
    study = load_study(study_file)
    values = np.array([[6.7e3], [-1.0]])
    refused = Study(
        name="refused",
        variants=study.variants,
        changes=(Change(("a|b.stiffness",), values),),
        rpm=study.rpm,
        keep=study.keep,
    )
    summary = jaxhb.campaign(refused, folder=tmp_path / "out")
    rows = rows_in(tmp_path / "out")
    assert rows["status"].tolist() == ["CONVERGED"] * 4 + ["INVALID_INPUT"] * 4
    (problem,) = summary.problems
    assert "stiffness" in problem
    assert summary.problems[problem] == 4
    assert rows[TORQUE].notna().tolist() == [True] * 4 + [False] * 4


def test_a_speed_that_fails_spoils_no_other(tmp_path, study_file, monkeypatch):
    solve = campaign_rows.steady_state

    def failing(train, *, rpm, **options):
        if 955.0 in rpm:
            raise ArithmeticError("no eigenvalue")
        return solve(train, rpm=rpm, **options)

    monkeypatch.setattr(campaign_rows, "steady_state", failing)
    summary = jaxhb.campaign(study_file, folder=tmp_path / "out")
    rows = rows_in(tmp_path / "out")
    failed = rows["rpm"] == 955.0
    assert set(rows["status"][failed]) == {"FAILED"}
    assert set(rows["status"][~failed]) == {"CONVERGED"}
    assert summary.problems == {"ArithmeticError: no eigenvalue": 6}


def test_an_answer_beyond_its_limits_is_told(tmp_path, study_file, monkeypatch):
    study_file.write_text(f'answers = "orbit"\n{study_file.read_text()}')
    jaxhb.campaign(study_file, folder=tmp_path / "whole")
    solve = campaign_rows.solve_speeds
    missed = jaxhb.Status.TOLERANCE_NOT_MET

    def coarse(train, *, rpm, **options):
        responses = solve(train, rpm=rpm, **options)
        return dataclasses.replace(responses, status=np.full(len(rpm), missed))

    monkeypatch.setattr(campaign_rows, "solve_speeds", coarse)
    summary = jaxhb.campaign(study_file, folder=tmp_path / "out")
    rows = rows_in(tmp_path / "out")
    assert set(rows["status"]) == {"TOLERANCE_NOT_MET"}
    assert summary.problems == {missed.sentence: len(rows)}
    assert rows[TORQUE].equals(rows_in(tmp_path / "whole")[TORQUE])


class LosingExecutor(Executor):
    """Runs parts at once, and loses each that holds 955 rpm."""

    def submit(self, function, /, *args):
        future = Future()
        *_, pieces = args
        if any(955.0 in piece.rpm for piece in pieces):
            future.set_exception(jaxhb.WorkerLost("the worker process ended"))
        else:
            future.set_result(function(*args))
        return future


def test_a_case_that_kills_its_workers_is_one_row(tmp_path, study_file):
    jaxhb.campaign(study_file, folder=tmp_path / "whole")
    summary = jaxhb.campaign(
        study_file, folder=tmp_path / "lost", executor=LosingExecutor()
    )
    rows = rows_in(tmp_path / "lost")
    lost = rows["rpm"] == 955.0
    assert set(rows["status"][lost]) == {"WORKER_LOST"}
    whole = rows_in(tmp_path / "whole")
    assert rows[~lost].equals(whole[~lost])
    assert summary.problems == {"the worker process ended": 6}


def test_rows_can_be_read_while_others_are_computed(tmp_path, study_file):
    folder = tmp_path / "out"
    lengths = []

    def look(count):
        if count:
            lengths.append(len(rows_in(folder)))

    jaxhb.campaign(study_file, folder=folder, progress=look)
    assert lengths == sorted(lengths)
    assert lengths[0] == 3
    assert lengths[-1] == 24


def test_samples_lie_within_the_tolerances_of_the_scene(tmp_path, study_file):
    scene = tmp_path / "pair.toml"
    tolerance = '[tolerance]\n"a.inertia" = { share = 0.1 }\n'
    scene.write_text(scene.read_text() + tolerance)
    study_file.write_text("samples = 5\nseed = 3\n" + study_file.read_text())
    jaxhb.campaign(study_file, folder=tmp_path / "out")
    rows = rows_in(tmp_path / "out")
    assert len(rows) == 5 * 24
    inertia = rows.groupby("sample")["a.inertia"].unique()
    assert [len(values) for values in inertia] == [1] * 5
    drawn = np.sort(np.concatenate(inertia.to_list()))
    # A Latin hypercube has one draw in each fifth of the range.
    fifths = np.floor((drawn - 0.9) / 0.2 * 5)
    assert fifths.tolist() == [0, 1, 2, 3, 4]


def test_a_campaign_of_no_design_is_one_of_the_scene_alone(tmp_path):
    train = jaxhb.load_scene("six_cylinder_diesel")
    study = Study(
        name="diesel",
        variants=(Variant("diesel", "", "", train),),
        changes=(),
        rpm=np.array([1800.0]),
        keep=(),
    )
    assert study.cases == study.parts == 1
    summary = jaxhb.campaign(study, folder=tmp_path / "out")
    assert isinstance(summary, CampaignSummary)
    assert summary.kinds == {"periodic": 1}


@pytest.fixture
def scheduler():
    """Address of a Dask scheduler with two workers, all processes of their own."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        processes=True,
        dashboard_address=None,
        silence_logs=50,
    ) as cluster:
        yield cluster


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # those of tornado and distributed
def test_a_dask_cluster_gives_the_same_rows_and_replaces_its_workers(
    tmp_path, study_file, scheduler
):
    jaxhb.campaign(study_file, folder=tmp_path / "alone")
    killed = []

    def kill(count):
        if count and not killed:
            (worker, *_) = scheduler.workers.values()
            killed.append(worker.pid)
            os.kill(worker.process.pid, 9)

    with jaxhb.Cluster(scheduler.scheduler_address) as cluster:
        jaxhb.campaign(
            study_file, folder=tmp_path / "dask", executor=cluster, progress=kill
        )
    assert killed
    assert rows_in(tmp_path / "dask").equals(rows_in(tmp_path / "alone"))


@pytest.mark.slow
def test_a_driver_that_was_killed_goes_on_with_the_same_rows(tmp_path, study_file):
    folder = tmp_path / "out"
    command = [*CAMPAIGN, str(study_file), "--quiet", "--workers", "2", "--out"]
    subprocess.run([*command, str(tmp_path / "whole")], check=True)
    driver = subprocess.Popen([*command, str(folder)])
    while not list(folder.glob("rows/*.parquet")):
        assert driver.poll() is None
    driver.kill()
    driver.wait()
    subprocess.run([*command, str(folder)], check=True)
    assert rows_in(folder).equals(rows_in(tmp_path / "whole"))
