"""Natural frequencies of random geared trees by jaxhb and openTorsion; where they
differ, mpmath says which is right.

    python benchmarks/opentorsion_trees.py                 200 trees, ten seconds
    python benchmarks/opentorsion_trees.py --wide          inertias and stiffnesses over two and three decades more
    python benchmarks/opentorsion_trees.py --trees 20 --seed 7 --json rows.jsonl

Half of the trees have elastic meshes, an external mesh of c N/m being openTorsion's
ElasticGear of c R^2 on the parent's radius R. The others have rigid meshes,
openTorsion's Gear: jaxhb gets the same train referred to one shaft, both gears of a
mesh as one disk. openTorsion has two functions: ``undamped_modal_analysis``
(eigenvalues of K, M) and ``modal_analysis`` (eigenvalues of the matrix of first order).
The judge is the dense matrix M^-1/2 K M^-1/2 of the parts as they are given, in 50
digits, whose eigenvalues ``mpmath.eigsy`` finds; for rigid meshes it is set up with the
gears bound to each other, not by referring numbers.

Errors are relative to the judge's frequency. ``rigid`` is the frequency of rigid
rotation, which is 0, over the lowest other one. The last table counts the frequencies
at which a code and jaxhb differ by more than 1e-9, and how often each of the two is the
nearer one there.
"""

import mpmath
import numpy as np
from opentorsion.assembly import Assembly
from opentorsion.elements.disk_element import Disk
from opentorsion.elements.elastic_gear_element import ElasticGear
from opentorsion.elements.gear_element import Gear
from opentorsion.elements.shaft_element import Shaft
from records import command_line, started

import jaxhb

DIGITS = 50
AGREED = 1e-9
DISKS = 5, 30
ORDINARY = ((-4, 0), (3, 6))
WIDE = ((-5, 2), (2, 8))
"""Decades of inertias (kg m2) and of stiffnesses of shafts (N m/rad)."""
OURS = "jaxhb"
UNDAMPED = "openTorsion, undamped_modal_analysis"
STATE = "openTorsion, modal_analysis"
COLUMNS = {"meshes": "<7s", "method": "<38s", "trees": "5d", "frequencies": "11d", "largest_error": "13.1e",
           "beyond_1e-9": "11d", "largest_rigid": "13.1e"}  # fmt: skip


def random_tree(random, decades=ORDINARY):
    """Rotors that are random trees of shafts, each but the first geared to an earlier
    one: ``inertia`` ``(S,)`` kg m2, ``shafts`` (disk, disk, N m/rad), ``meshes`` (gear
    of the earlier rotor, gear, their radii in m, N/m).
    """
    disks = int(random.integers(*DISKS, endpoint=True))
    inertia = (10 ** random.uniform(*decades[0], disks)).tolist()
    shafts = []
    meshes = []
    rotor = [0]
    radius = random.uniform(0.03, 0.2, disks).tolist()
    for disk in range(1, disks):
        if random.random() < 0.7 or disk == 1:
            mates = np.flatnonzero(np.array(rotor) == rotor[-1])
            shafts.append(
                (int(random.choice(mates)), disk, 10 ** random.uniform(*decades[1]))
            )
            rotor.append(rotor[-1])
        else:
            mate = int(random.integers(disk))
            meshes.append(
                (mate, disk, radius[mate], radius[disk], 10 ** random.uniform(7, 9))
            )
            rotor.append(rotor[-1] + 1)
    return {"inertia": inertia, "shafts": shafts, "meshes": meshes}


def speeds(tree, one=1.0):
    """Speed of each disk over that of the first, signs by the direction of rotation, in
    the numbers of ``one``.
    """
    found = [one] + [None] * (len(tree["inertia"]) - 1)
    ratios = {b: (a, one) for a, b, _ in tree["shafts"]}
    ratios |= {b: (a, -one * r_a / r_b) for a, b, r_a, r_b, _ in tree["meshes"]}
    for disk in range(1, len(found)):  # the disk above has a smaller number
        above, ratio = ratios[disk]
        found[disk] = found[above] * ratio
    return found


def by_jaxhb(tree, rigid):
    """rad/s, rising."""
    return (
        2
        * np.pi
        * jaxhb.natural_frequencies(
            jaxhb.build(parts(tree, rigid), reference="0")
        ).frequencies_hz
    )


def parts(tree, rigid):
    """Elements of jaxhb; with ``rigid`` teeth all numbers referred to the first shaft,
    gears in mesh as one disk.
    """
    toothed = {
        disk: r
        for a, b, r_a, r_b, _ in tree["meshes"]
        for disk, r in ((a, r_a), (b, r_b))
    }
    if not rigid:
        made = [
            jaxhb.Disk(name=str(i), inertia=J, radius=toothed.get(i))
            for i, J in enumerate(tree["inertia"])
        ]
        made += [
            jaxhb.Shaft(between=(str(a), str(b)), stiffness=k)
            for a, b, k in tree["shafts"]
        ]
        return made + [
            jaxhb.Mesh(between=(str(a), str(b)), stiffness=c)
            for a, b, *_, c in tree["meshes"]
        ]
    ratio = speeds(tree)
    held_by = {b: a for a, b, *_ in tree["meshes"]}

    def place(disk):
        return place(held_by[disk]) if disk in held_by else disk

    inertia = dict.fromkeys((place(i) for i in range(len(ratio))), 0.0)
    for disk, J in enumerate(tree["inertia"]):
        inertia[place(disk)] += J * ratio[disk] ** 2
    made = [jaxhb.Disk(name=str(i), inertia=J) for i, J in inertia.items()]
    return made + [
        jaxhb.Shaft(between=(str(place(a)), str(place(b))), stiffness=k * ratio[a] ** 2)
        for a, b, k in tree["shafts"]
    ]


def assembly(tree, rigid):
    """The tree as openTorsion has it."""
    shafts = [Shaft(a, b, k=k) for a, b, k in tree["shafts"]]
    disks = [Disk(i, J) for i, J in enumerate(tree["inertia"])]
    gears = []
    parents = {}
    kind = Gear if rigid else ElasticGear
    for a, b, r_a, r_b, c in tree["meshes"]:
        if a not in parents:
            parents[a] = kind(a, 0.0, r_a)
            gears.append(parents[a])
        own = {} if rigid else {"k": c * r_a**2, "c": 0.0}
        gears.append(kind(b, 0.0, r_b, parent=parents[a], **own))
        parents[b] = gears[-1]
    return Assembly(
        shafts,
        disks,
        **{"gear_elements" if rigid else "elastic_gear_elements": gears or None},
    )


def by_opentorsion(tree, rigid):
    """rad/s, rising, by both of its functions; of an eigenvalue that is not a positive
    number, its modulus.
    """
    model = assembly(tree, rigid)
    squares, _ = model.undamped_modal_analysis()
    states, *_ = model.modal_analysis()
    return {UNDAMPED: np.sort(np.sqrt(np.abs(squares))), STATE: np.sort(states)[::2]}


def by_mpmath(tree, rigid):
    """rad/s, rising, in mpmath's numbers."""
    size = len(tree["inertia"])
    K = mpmath.zeros(size)
    T = mpmath.eye(size)
    rows = [((a, b), (mpmath.mpf(1), mpmath.mpf(-1)), k) for a, b, k in tree["shafts"]]
    if rigid:  # angles of gears that are driven follow those of the drivers
        ratio = speeds(tree, mpmath.mpf(1))
        held_by = {b: a for a, b, *_ in tree["meshes"]}
        free = [disk for disk in range(size) if disk not in held_by]
        T = mpmath.zeros(size, len(free))
        for disk in range(size):
            holder = disk
            while holder in held_by:
                holder = held_by[holder]
            T[disk, free.index(holder)] = ratio[disk] / ratio[holder]
    else:
        rows += [
            ((a, b), (mpmath.mpf(r_a), mpmath.mpf(r_b)), c)
            for a, b, r_a, r_b, c in tree["meshes"]
        ]
    for ends, arms, k in rows:
        for i, x in zip(ends, arms, strict=True):
            for j, y in zip(ends, arms, strict=True):
                K[i, j] += x * y * mpmath.mpf(k)
    K = T.T * K * T
    J = T.T * mpmath.diag([mpmath.mpf(J) for J in tree["inertia"]]) * T
    scale = [1 / mpmath.sqrt(J[i, i]) for i in range(K.rows)]
    for i in range(K.rows):
        for j in range(K.rows):
            K[i, j] *= scale[i] * scale[j]
    return [mpmath.sqrt(abs(value)) for value in mpmath.eigsy(K, eigvals_only=True)]


def compared(tree, rigid):
    """Errors ``(m - 1,)`` of the elastic frequencies and rigid frequency over the
    lowest of them, by method.
    """
    true = by_mpmath(tree, rigid)
    assert true[0] < true[1] * mpmath.mpf(10) ** (-DIGITS // 4)  # one rigid rotation
    found = {OURS: by_jaxhb(tree, rigid)} | by_opentorsion(tree, rigid)
    return {
        method: (
            np.array(
                [
                    float(abs(mpmath.mpf(float(w)) / t - 1))
                    for w, t in zip(omega[1:], true[1:], strict=True)
                ]
            ),
            float(omega[0] / true[1]),
            omega[1:],
        )
        for method, omega in found.items()
    }


def main():
    """Compare on all trees and print."""
    parser = command_line(__doc__, core=-1)
    parser.add_argument("--trees", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--wide", action="store_true", help="numbers of trees further apart"
    )
    options = parser.parse_args()
    mpmath.mp.dps = DIGITS
    random = np.random.default_rng(options.seed)
    found = {"elastic": [], "rigid": []}
    for number in range(options.trees):
        rigid = number >= (options.trees + 1) // 2
        tree = random_tree(random, WIDE if options.wide else ORDINARY)
        found["rigid" if rigid else "elastic"].append(compared(tree, rigid))
    recorder = started("opentorsion_trees", options, COLUMNS)
    differing = dict.fromkeys((UNDAMPED, STATE), (0, 0, 0))
    for meshes, trees in found.items():
        for method in (OURS, UNDAMPED, STATE) if trees else ():
            errors = np.concatenate([tree[method][0] for tree in trees])
            recorder.add(
                meshes=meshes,
                method=method,
                trees=len(trees),
                frequencies=len(errors),
                largest_error=float(errors.max()),
                largest_rigid=max(tree[method][1] for tree in trees),
                **{"beyond_1e-9": int((errors > AGREED).sum())},
            )
            if method != OURS:
                own, omega = (
                    np.concatenate([tree[OURS][i] for tree in trees]) for i in (0, 2)
                )
                apart = (
                    np.abs(
                        np.concatenate([tree[method][2] for tree in trees]) / omega - 1
                    )
                    > AGREED
                )
                counts = (
                    apart.sum(),
                    (apart & (own < errors)).sum(),
                    (apart & (errors < own)).sum(),
                )
                differing[method] = tuple(
                    int(a + b) for a, b in zip(differing[method], counts, strict=True)
                )
    for method, (apart, ours, theirs) in differing.items():
        print(
            f"{method}: {apart} frequencies differ from jaxhb's by more than"
            f" {AGREED:g};",
            end=" ",
        )
        print(f"jaxhb is nearer to mpmath in {ours}, openTorsion in {theirs}")


if __name__ == "__main__":
    main()
