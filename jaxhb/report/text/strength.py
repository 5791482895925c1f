"""Stresses, tooth torques and heat beside their limits, as text and as plain numbers."""

from types import SimpleNamespace

import numpy as np

from jaxhb.linear.strength import HIGHEST, NOT_ABOVE, judged
from jaxhb.report.answer import NO_SIGNAL
from jaxhb.report.text.columns import NONE, Table, alike, ranges

AID = "evaluation aid, no class approval"

ENOUGH, NEAR = 50, 0.01
"""Speeds from which barred ranges are found; share of the highest speed of the rule that may be missing."""

RULE = """\
Limits after IACS UR M68 for intermediate, thrust and propeller shafts, lambda = speed / {rated:g} rpm: to be checked
against its current text. Tensile strengths count up to 800 MPa; of carbon steels and propeller shafts the rule counts
at most 600 MPa. They do NOT hold for crankshafts: these have a rule of their own, IACS UR M53, which adds bending,
fillets and oil holes, and is not computed here."""


class _OfAnswers:
    """How answers at several speeds are read, as :func:`jaxhb.linear.strength.judged` asks: nan without an answer."""

    def __init__(self, answers):
        self.answers = answers

    def torque(self, name):
        return self._stacked([answer.torque(name) if answer.answered else NO_SIGNAL for answer in self.answers])

    def force(self, name):
        return self._stacked([answer.force(name) if answer.answered else NO_SIGNAL for answer in self.answers])

    def power(self, name):
        return np.array([answer.power(name) if answer.answered else np.nan for answer in self.answers])

    @staticmethod
    def _stacked(signals):
        names = "mean", "min", "max", "half_peak_to_peak"
        return SimpleNamespace(**{name: np.array([float(getattr(s, name)) for s in signals]) for name in names})


def answers_strength(answers):
    """The :class:`jaxhb.Strength` of answers of one train, at least one, with arrays over their speeds."""
    return judged(answers[0].train, np.array([answer.rpm for answer in answers]), _OfAnswers(answers))


def strength_text(judged):
    """Tables for people in a list: of several speeds the worst of each element; empty where scenes give no numbers.

    Parameters
    ----------
    judged : dict
        :class:`jaxhb.Strength` of lists of speeds, by headings; one without heading has the key "".

    Returns
    -------
    list of str
    """
    parts, limited = [], ""
    for title, found in judged.items():
        tables = (_stress_table, found.stresses), (_tooth_table, found.tooth_torques), (_heat_table, found.heat)
        own = [table(found.rpm, rows) for table, rows in tables if rows]
        if any(row.continuous is not None for row in found.stresses.values()):
            limited = RULE.format(rated=found.rated_rpm)
            own += [_barred_text(found)] if len(found.rpm) > 1 else []
        parts += ([f"{title}\n{own[0]}"] if title and own else own[:1]) + own[1:]
    return [*parts, limited] if limited else parts


def _stress_table(rpm, rows):
    places = [_worst(row.stress, row.continuous) for row in rows.values()]
    stress, continuous, transient = (
        _picked(rows, places, name, 1e-6) for name in ("stress", "continuous", "transient")
    )
    columns = alike(stress, continuous, transient)
    heads = ["shaft", "stress", "at rpm", "continuous limit", "transient limit", "share"]
    cells = [list(rows), columns[0], _speeds(rpm, places), *columns[1:], _shares(stress, continuous)]
    title = f"Torsional stress of shafts, MPa: half of peak-to-peak torque / W_p ({AID})"
    return _table(title, rpm, heads, cells)


def _tooth_table(rpm, rows):
    places = [_worst(row.vibratory, row.limit) for row in rows.values()]
    vibratory, limit, mean = (_picked(rows, places, name) for name in ("vibratory", "limit", "mean"))
    columns = alike(vibratory, limit, mean)
    heads = ["mesh", "vibratory", "at rpm", "limit", "mean", "share", "reverses"]
    reverses = [_where(rpm, row.reverses) for row in rows.values()]
    cells = [list(rows), columns[0], _speeds(rpm, places), *columns[1:], _shares(vibratory, limit), reverses]
    title = f"Torque of meshes on the first gear, N m: half peak-to-peak, limit a third of the rated torque ({AID})"
    return _table(title, rpm, heads, cells)


def _where(rpm, happens):
    """Speeds at which something happens; of one speed whether it does."""
    if len(rpm) == 1:
        return "yes" if happens[0] else "no"
    said = ranges(list(rpm), [speed for speed, does in zip(rpm, happens, strict=True) if does])
    return f"at {said} rpm" if said else NONE


def _heat_table(rpm, rows):
    places = [_worst(row.power, row.limit) for row in rows.values()]
    power, limit = (_picked(rows, places, name) for name in ("power", "limit"))
    columns = alike(power, limit)
    heads = ["shaft or damper", "heat", "at rpm", "limit", "share"]
    cells = [list(rows), columns[0], _speeds(rpm, places), columns[1], _shares(power, limit)]
    return _table(f"Heat of shafts and dampers, W ({AID})", rpm, heads, cells)


def _table(title, rpm, heads, columns):
    """Columns under their heads, without that of the speeds where there is one speed."""
    kept = [i for i, head in enumerate(heads) if len(rpm) > 1 or head != "at rpm"]
    return Table(title, [heads[i] for i in kept], [columns[i] for i in kept])


def _worst(values, limit):
    """Place of the largest share of the limit, of the largest value without one; None where nothing is known."""
    shares = np.asarray(values, dtype=float)
    if limit is not None and np.any(np.isfinite(shares) & np.isfinite(limit)):
        shares = np.where(np.isfinite(limit), shares / limit, np.nan)
    return int(np.nanargmax(shares)) if np.isfinite(shares).any() else None


def _picked(rows, places, name, factor=1.0):
    """A number of every row at its place, nan where there is none."""
    both = [(getattr(row, name), i) for row, i in zip(rows.values(), places, strict=True)]
    return [
        float("nan")
        if values is None or i is None
        else factor * float(np.ravel(values)[i if np.size(values) > 1 else 0])
        for values, i in both
    ]


def _speeds(rpm, places):
    return [NONE if i is None else f"{rpm[i]:g}" for i in places]


def _shares(values, limits):
    """Values over their limits, two decimals."""
    both = zip(values, limits, strict=True)
    return [f"{value / limit:.2f}" if np.isfinite(value) and np.isfinite(limit) else NONE for value, limit in both]


def _barred_text(found):
    """What is barred of several speeds, one range a line, and where nothing is judged."""
    barred = [(name, one) for name, several in found.barred.items() for one in several]
    limited = {name: row for name, row in found.stresses.items() if row.continuous is not None}
    first = next(iter(limited.values()))
    within, rpm = np.isfinite(first.continuous), np.asarray(found.rpm)
    said = []
    if within.any():
        head = "Barred speed ranges" if barred else "No barred speed range"
        said = [f"{head} between {rpm[within].min():g} and {rpm[within].max():g} rpm ({AID})"]
        said += [_range_text(name, one, found.rated_rpm) for name, one in barred]
        said += [_judged_from(rpm[within & np.isfinite(first.stress)], HIGHEST * found.rated_rpm)]
    return "\n".join([*said, *_beyond_text(rpm, limited, ~within, found.rated_rpm)])


def _judged_from(speeds, highest):
    """From how many speeds barred ranges were judged, and what that leaves out."""
    said = f"Judged from {len(speeds)} speed{'s' * (len(speeds) != 1)}"
    few = f": resonances between them are NOT seen, take {ENOUGH} or more" if len(speeds) < ENOUGH else ""
    short = len(speeds) and speeds.max() < (1 - NEAR) * highest
    up = f" The rule looks up to {highest:g} rpm, {HIGHEST:g} of the rated speed: NOT judged there." if short else ""
    return f"{said}{few}.{up}"


def _beyond_text(rpm, limited, beyond, rated):
    """What the stresses are at the speeds for which the rule has no limit."""
    if not beyond.any():
        return []
    largest = []
    for name, row in limited.items():
        values = np.where(beyond, row.stress, np.nan)
        if np.isfinite(values).any():
            place = int(np.nanargmax(values))
            largest.append(f"{name} {1e-6 * values[place]:.4g} MPa at {rpm[place]:g} rpm")
    told = f"; largest there: {', '.join(largest)}" if largest else ""
    return [f"Above {HIGHEST * rated:g} rpm, {HIGHEST:g} of the rated speed, the rule has no limit: NOT judged{told}."]


def _range_text(name, one, rated):
    """One barred range as a line."""
    low, high = (f"{speed:.4g}" for speed in (one.low, one.high))
    low, high = f"{low} or below" if one.open_below else low, f"{high} or above" if one.open_above else high
    said = f"  {name}: {low} to {high} rpm, {one.share:.2f} of the continuous limit at {one.at:g} rpm"
    beyond = f"ABOVE THE TRANSIENT LIMIT ({one.transient_share:.2f} of it)"
    late = f"; not accepted above {NOT_ABOVE:g} of the rated speed" if one.high > NOT_ABOVE * rated else ""
    return f"{said}, {'within the transient limit' if one.passable else beyond}{late}"


def strength_record(found):
    """What the files hold of a :class:`jaxhb.Strength`: SI units, lists over the speeds.

    Returns
    -------
    dict
        ``note``, ``rated_rpm``; by name ``stresses``: ``stress_Pa``, ``continuous_Pa``, ``transient_Pa`` (None where
        there is no limit) and ``barred``, the ranges as :class:`jaxhb.BarredRange` with ``passable``;
        ``tooth_torques``: ``vibratory_Nm``, ``limit_Nm``, ``mean_Nm``, ``reverses``; ``heat``: ``power_W``,
        ``limit_W``. Empty where the scene gives no numbers.
    """
    if not found:
        return {}
    barred = found.barred
    stresses = {
        name: _record(row, "Pa")
        | ({"barred": [vars(one) | {"passable": one.passable} for one in barred[name]]} if name in barred else {})
        for name, row in found.stresses.items()
    }
    return {
        "note": AID,
        "rated_rpm": found.rated_rpm,
        "stresses": stresses,
        "tooth_torques": {name: _record(row, "Nm") for name, row in found.tooth_torques.items()},
        "heat": {name: _record(row, "W") for name, row in found.heat.items()},
    }


def _record(row, unit):
    """A named tuple of arrays as lists and numbers."""
    return {
        name if name == "reverses" else f"{name}_{unit}": None if values is None else np.asarray(values).tolist()
        for name, values in row._asdict().items()
    }


def strength_columns(found):
    """Columns of the CSV files by their heads, SI units, a list over the speeds each."""
    kinds = {"stresses": "Pa", "tooth_torques": "N m", "heat": "W"}
    columns = {}
    for kind, unit in kinds.items():
        for name, row in getattr(found, kind).items():
            for what, values in row._asdict().items():
                head = f"{name} {_CALLED[kind].get(what, what)}{'' if what == 'reverses' else f' {unit}'}"
                columns |= {} if values is None else {head: np.broadcast_to(values, np.shape(found.rpm)).tolist()}
    return columns


_CALLED = {
    "stresses": {"continuous": "continuous limit", "transient": "transient limit"},
    "tooth_torques": {"vibratory": "vibratory torque", "limit": "limit of vibratory torque", "mean": "mean torque"},
    "heat": {"power": "heat", "limit": "limit of heat"},
}
"""What the heads of columns call the numbers."""


def strength_entry(answer):
    """``{"strength": ...}`` of one speed, numbers instead of lists and no ranges; empty where the scene gives none."""
    found = strength_record(answers_strength([answer]))
    return {"strength": _single(found)} if found else {}


def _single(value):
    if isinstance(value, dict):
        return {key: _single(item) for key, item in value.items() if key != "barred"}
    return value[0] if isinstance(value, list) else value
