"""A fault hides no other: every check runs on what is sound, and a fault breeds no false sentences."""

import pytest

from jaxhb.elements.elements import Cylinder, Damper, Disk, Ground, Load, Mesh, SceneError, Shaft, Torque
from jaxhb.scene.files import load_scene
from jaxhb.train.assembly import build

TABLE = [(float(a), 1e5) for a in range(0, 721, 10)]
STIFFNESS = "stiffness is -1 N m/rad"
DAMPING = "damping is -1 N m s/rad"
ORDER = "order 0.3 is harmonic 0.6"
BALANCE = "the mean torques leave 5 N m"
PIECES = "falls into pieces"
UNKNOWN = "there is no disk 'zz'"
RADIUS = "disk 'g' has no radius"
LOOP = "locked closed loop"
VISCOUS = "a mean torque acts on 'ring'"
ONE_ROTOR = "are on one rotor"
TEETH = "teeth 20:41"
REPEATED = "the name 'x' is taken"


def disks(*names, **more):
    return [Disk(name=name, inertia=1.0, **more) for name in names]


def shaft(a, b, **more):
    return Shaft(between=(a, b), **({"stiffness": 1e4} | more))


def mesh(a, b, **more):
    return Mesh(between=(a, b), stiffness=1e8, **more)


MISFIT = Torque(disk="a", harmonics=[(0.3, 1.0, 0.0)])
PULL = Torque(disk="a", mean=5.0)
RING = Damper(name="ring", disk="a", inertia=1.0, damping=1.0)
AB = [*disks("a", "b", radius=0.1), shaft("a", "b")]
RINGED = [*disks("e", "f", "h", radius=0.1), mesh("e", "f"), mesh("f", "h"), mesh("h", "e"), shaft("a", "e")]
CASES = {
    "stiffness, order, pieces": (
        [*disks("a", "b", "c", radius=0.1), shaft("a", "b", stiffness=-1), MISFIT],
        [STIFFNESS, PIECES, ORDER],
    ),
    "unknown disk, mesh without radius": ([*AB, *disks("g"), mesh("a", "g"), shaft("zz", "b")], [UNKNOWN, RADIUS]),
    "damping, order, balance": (
        [*disks("a", "b"), shaft("a", "b", damping=-1), MISFIT, PULL],
        [DAMPING, ORDER, BALANCE],
    ),
    "unknown load, order, loop": ([*AB, *RINGED, MISFIT, Load(disk="zz")], [UNKNOWN, ORDER, LOOP]),
    "negative inertia, balance": ([*AB, Disk(name="c", inertia=-1.0), shaft("b", "c"), PULL], ["inertia is", BALANCE]),
    "viscous ring, order": ([*AB, RING, Torque(disk="ring", mean=5.0), Load(disk="b"), MISFIT], [VISCOUS, ORDER]),
    "pieces, loop in the other piece": ([*AB, *RINGED[:-1]], [PIECES, LOOP]),
    "order of an unknown disk": ([*AB, Torque(disk="zz", harmonics=[(0.3, 1.0, 0.0)])], [UNKNOWN, ORDER]),
    "one order of several is bad": (
        [*AB, Torque(disk="a", harmonics=[(-1.0, 1.0, 0.0), (0.3, 1.0, 0.0)])],
        ["order is -1", ORDER],
    ),
    "teeth, pieces, mesh on one rotor": (
        [
            *AB,
            Disk(name="c", inertia=1.0, radius=0.1, teeth=20),
            Disk(name="d", inertia=1.0, radius=0.2, teeth=41),
            mesh("c", "d"),
            mesh("a", "b"),
        ],
        [TEETH, PIECES, ONE_ROTOR],
    ),
    "repeated name, order": ([*AB, *disks("x", "x"), shaft("b", "x"), MISFIT], [REPEATED, ORDER]),
    "pressure of two rows, which make no step of half a cycle, order": (
        [*AB, Load(disk="b"), MISFIT, Cylinder(disk="a", bore=0.1, stroke=0.1, rod=0.2, pressure=TABLE[:21:20])],
        ["pressure covers 0 to 200 deg", ORDER],
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_each_fault_of_a_scene_is_told_and_nothing_else(case):
    parts, wanted = CASES[case]
    with pytest.raises(SceneError) as caught:
        build(parts, reference="a")
    assert len(caught.value.sentences) == len(wanted), caught.value
    for text in wanted:
        assert sum(text in sentence for sentence in caught.value.sentences) == 1, text


@pytest.mark.parametrize(
    "more",
    [
        [PULL, Torque(disk="b", mean=float("nan"))],
        [PULL, Ground(disk="zz", stiffness=1.0)],
        [Torque(disk="ring", mean=1.0), Load(disk="b")],
        [PULL, Torque(disk="b", mean=-5.0, scale=[(2.0, 1.0), (1.0, 1.0)])],
    ],
)
def test_what_is_unknown_breeds_no_false_sentence(more):
    bad = Damper(name="ring", disk="a", inertia=1.0, damping=1.0, stiffness=-1.0)
    with pytest.raises(SceneError) as caught:
        build([*AB, bad, *more], reference="a")
    assert not any("mean torque" in sentence for sentence in caught.value.sentences)


def test_an_unread_file_and_an_unknown_table_hide_no_order(tmp_path):
    text = "[[disk]]\nname='a'\ninertia=1\nradius=1\n[[disk]]\nname='b'\ninertia=1\nradius=1\n[[meshs]]\nx=1\n"
    text += "[[torque]]\ndisk='a'\nharmonics=[[0.3, 1, 0]]\n"
    text += "[[cylinder]]\ndisk='a'\nbore=0.1\nstroke=0.1\nrod=0.2\npressure='p.csv'\n"
    path = tmp_path / "gears.toml"
    path.write_text(text)
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    assert len(caught.value.sentences) == 3
    assert [text in str(caught.value) for text in ("unknown table 'meshs'", "no file 'p.csv'", ORDER)] == [True] * 3


@pytest.mark.parametrize(
    "span, good", [(200, False), (360, True), (350, True), (340, False), (720, True), (710, True), (700, False)]
)
def test_a_pressure_table_covers_the_gas_cycle_but_for_one_step(span, good):
    table = [row for row in TABLE if row[0] <= span]
    parts = [*AB, Load(disk="b"), Cylinder(disk="a", bore=0.1, stroke=0.1, rod=0.2, pressure=table)]
    if good:
        build(parts)
        return
    with pytest.raises(
        SceneError, match=f"pressure covers 0 to {span} deg, must cover a whole gas cycle of (36|72)0 deg"
    ):
        build(parts)


def test_an_order_that_rounds_to_the_mean_is_refused():
    tiny = [(1e-8, 1.0, 0.0)]
    with pytest.raises(SceneError, match=r"order 1e-08 is harmonic 2e-08 .* at least 1\. Give the mean as mean = …"):
        build([*AB, Torque(disk="a", harmonics=tiny)])
    with pytest.raises(SceneError, match=r"at least 1\. Give the mean as gas_torque_mean = …"):
        build([*AB, Load(disk="b"), Cylinder(disk="a", gas_torque=tiny)])


@pytest.mark.parametrize("digits", ["9" * 400, "9" * 5000, "0x" + "f" * 5000], ids=["400", "5000", "hex"])
@pytest.mark.parametrize(
    "place",
    [
        "[[shaft]]\nbetween = ['a', 'b']\nstiffness = {}",
        "[[torque]]\ndisk = 'a'\nharmonics = [[{}, 1, 1]]",
        "[scene]\nrevolutions_per_cycle = {}",
        "[[disk]]\nname = 'c'\ninertia = 1\nradius = 1\nteeth = {}",
    ],
)
def test_an_integer_too_large_for_a_double_is_a_sentence(tmp_path, digits, place):
    path = tmp_path / "gears.toml"
    path.write_text("[[disk]]\nname = 'a'\ninertia = 1\n[[disk]]\nname = 'b'\ninertia = 1\n" + place.format(digits))
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    assert "digits" in str(caught.value) or "too long to be written" in str(caught.value) or "9999" in str(caught.value)
    assert max(len(sentence) for sentence in caught.value.sentences) < 300


def test_faults_of_varying_links_and_scenarios_come_all_at_once():
    rows = [(-1.0, 1.0, 1.0), (5.0, 0.0, -1.0)]
    parts = [*disks("a", "b"), shaft("a", "b", over_hz=rows, over_amplitude=[(2.0, 1.0, 1.0), (1.0, 1.0, 1.0)])]
    with pytest.raises(SceneError) as raised:
        build([*parts, MISFIT], scenarios={"hot": {"a|b.stiffness": -1.0, "zz.damping": 1.0}})
    said = str(raised.value)
    for text in (
        "over_hz, row 1: hz is -1",
        "over_hz, row 2: factor of stiffness is 0",
        "over_hz, row 2: factor of damping is -1",
        "over_amplitude, row 2: amplitude 1 after 2",
        ORDER,
        f"[scenario.hot]: 'a|b': {STIFFNESS}",
        "there is no element 'zz'",
    ):
        assert said.count(text) == 1
