"""Figures from the JSON lines of the other benchmarks; runs none of them.

    python benchmarks/figures.py                            benchmarks/results/*.jsonl -> benchmarks/figures/*.png
    python benchmarks/figures.py rows.jsonl --to folder     other rows

``work_precision.png`` has error against run time, one curve per method and one panel
per train; ``scaling.png`` run time against size and the start-up of a fresh process;
``peers.png`` the chain task. What has no rows is not drawn.
"""

import argparse
import json
import statistics
from pathlib import Path

import matplotlib
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from records import exponent

FOLDER = Path(__file__).parent
METHODS = {
    "jaxhb": ("jaxhb", "C3", "o"),
    "rk4": ("Runge-Kutta 4, numba", "C0", "s"),
    "implicit": ("implicit along the tree, numba", "C2", "^"),
    "exponential": ("modal exponential, JAX", "C1", "D"),
    "exp. batch": ("modal exponential, JAX, a batch", "C8", "d"),
    "Tsit5": ("Tsit5, diffrax", "C4", "v"),
    "Dopri8": ("Dopri8, diffrax", "C5", "<"),
    "LSODA": ("LSODA, scipy", "C7", ">"),
    "DOP853": ("DOP853, scipy", "C9", "p"),
    "chain": ("full chain, Newton", "k", "x"),
}
RIVALS = {"jaxhb": "jaxhb", "rk4": "Runge-Kutta 4", "implicit": "implicit"}
LOST = ("never settles", "out of time", "diverged", "STALLED", "MAX_STEPS")


def read(paths):
    """Rows of JSON-lines files by benchmark."""
    rows = {}
    for path in paths:
        for line in Path(path).read_text().splitlines():
            row = json.loads(line)
            rows.setdefault(row["benchmark"], []).append(row)
    return rows


def curves(rows):
    """Work-precision of one panel: method -> [(seconds, error, speeds reached)], a
    point per setting.

    Medians over the speeds at which the method came to a periodic motion; the number of
    steps that stability asks for differs between speeds and counts as one setting.
    """
    found = {}
    for method in dict.fromkeys(row["method"] for row in rows):
        settings = {}
        for row in rows:
            if (
                row["method"] == method
                and row["error"]
                and row.get("seconds")
                and row["status"] not in LOST
            ):
                settings.setdefault(row["setting"], []).append(
                    (row["seconds"], row["error"])
                )
        points = [
            (*map(statistics.median, zip(*pairs, strict=True)), len(pairs))
            for pairs in settings.values()
        ]
        if points:
            found[method] = _cheapest(points)
    return found


def _settled(row):
    return bool(
        row["error"]
        and row["error"] <= 0.1
        and row.get("seconds")
        and row["status"] not in LOST
    )


def compared(rows):
    """Speeds at which all of RIVALS that came to a periodic motion at any did; medians
    over others compare nothing.
    """
    reached = [
        {row["rpm"] for row in rows if row["method"] == method and _settled(row)}
        for method in RIVALS
    ]
    return (
        set.intersection(*filter(None, reached))
        if any(reached)
        else {row["rpm"] for row in rows}
    )


def _cheapest(points):
    """Of several settings those that no other beats in time and (but for 5 %) error at
    as many speeds, by time.
    """
    kept = [
        p
        for p in points
        if not any(q[0] < p[0] and q[1] <= 1.05 * p[1] and q[2] >= p[2] for q in points)
    ]
    return sorted(kept)


def work_precision(rows):
    """Error of the tooth force against run time."""
    panels = list(dict.fromkeys((row["disks"], row["damping_percent"]) for row in rows))
    columns = min(3, len(panels))
    figure, axes = _axes(-(-len(panels) // columns), columns, 4.3, 3.7)
    for (disks, damping), ax in zip(panels, axes, strict=False):
        every = [
            r for r in rows if (r["disks"], r["damping_percent"]) == (disks, damping)
        ]
        speeds = sorted(compared(every))
        count = len({row["rpm"] for row in every})
        own = [row for row in every if row["rpm"] in speeds]
        for method, points in curves(own).items():
            label, color, marker = METHODS[method]
            seconds, errors, reached = zip(*points, strict=True)
            x = [1e3 * s for s in seconds]
            y = [100 * e for e in errors]
            ax.plot(
                x,
                y,
                color=color,
                marker=marker,
                markersize=5,
                label=label,
                linewidth=1.2,
            )
            part = [i for i, count in enumerate(reached) if count < len(speeds)]
            ax.plot(
                [x[i] for i in part],
                [y[i] for i in part],
                marker,
                color="w",
                markersize=2.5,
            )
        told = f"{len(speeds)} speeds" if len(speeds) > 1 else f"{speeds[0]:.0f} rpm"
        told += (
            ""
            if len(speeds) == count
            else f" of {count}"
            if len(speeds) > 1
            else f", one of {count} speeds"
        )
        ax.set(xscale="log", yscale="log", xlabel="run time per speed in ms")
        _plain(ax.xaxis)
        _plain(ax.yaxis)
        ax.set_title(f"{disks} disks, tooth damping {damping:g} %, {told}", fontsize=9)
        _lost(ax, every)
        ax.axhline(1, color="0.7", linewidth=0.8, zorder=0)
    for ax in axes[::columns]:
        ax.set_ylabel("error in % of the largest tooth force")
    figure.suptitle("each panel: the speeds that all of its methods solve", fontsize=9)
    handles = {
        label: h
        for ax in axes
        for h, label in zip(*ax.get_legend_handles_labels(), strict=True)
    }
    figure.legend(
        handles.values(),
        handles,
        loc="outside lower center",
        ncols=min(4, len(handles)),
        fontsize=8,
    )
    return figure


def _lost(ax, rows):
    """Notes on the rivals: a stable step that is hopeless, speeds at which no periodic
    motion was found.
    """
    hopeless = [r["seconds"] for r in rows if r["status"] == "step too small"]
    notes = (
        [("rk4", f"Runge-Kutta 4: about {statistics.median(hopeless) / 3600:.2g} h")]
        if hopeless
        else []
    )
    for method in RIVALS:
        own = [
            r for r in rows if r["method"] == method and r["status"] != "step too small"
        ]
        tried = {r["rpm"] for r in own}
        settled = {r["rpm"] for r in own if _settled(r)}
        if tried - settled:
            what = "finds no motion" if method == "jaxhb" else "never settles"
            notes.append(
                (
                    method,
                    (
                        f"{RIVALS[method]} {what} at {len(tried - settled)} of"
                        f" {len(tried)} speeds"
                    ),
                )
            )
    low, high = ax.get_ylim()
    ax.set_ylim(low, high * (high / low) ** (0.09 * len(notes)))
    for line, (method, note) in enumerate(notes):
        place = {"transform": ax.transAxes, "ha": "right", "va": "top"}
        ax.text(
            0.97,
            0.96 - 0.07 * line,
            note,
            **place,
            fontsize=8,
            color=METHODS[method][1],
        )


SIZES = {
    "harmonics": "harmonics of the cycle",
    "disks": "disks",
    "meshes": "meshes with backlash",
    "speeds": "speeds in one call",
}


def scaling(rows):
    """Run time against size, and start-up."""
    parts = [
        part for part in (*SIZES, "compile") if any(r["part"] == part for r in rows)
    ]
    columns = min(3, len(parts))
    figure, axes = _axes(-(-len(parts) // columns), columns, 4.3, 3.5)
    for part, ax in zip(parts, axes, strict=False):
        own = [r for r in rows if r["part"] == part]
        if part == "compile":
            _start_up(ax, own)
            continue
        for setting in dict.fromkeys(r["setting"] for r in own):
            good = [
                r
                for r in own
                if r["setting"] == setting
                and r.get("seconds")
                and r["status"] not in LOST
            ]
            if not good:
                continue
            sizes = [r["size"] for r in good]
            seconds = [r["seconds"] for r in good]
            slope = (
                f", exponent {exponent(sizes, seconds):.2f}"
                if len(good) > 1 and part != "speeds"
                else ""
            )
            ax.plot(
                sizes,
                [1e3 * s for s in seconds],
                "o-",
                label=setting + slope,
                linewidth=1.2,
                markersize=4,
            )
        ax.set(
            xscale="log",
            yscale="log",
            xlabel=SIZES[part],
            ylabel="run time per speed in ms",
        )
        ax.set_ylim(ax.get_ylim()[0] / 1.5, ax.get_ylim()[1] * 4)
        sizes = sorted({r["size"] for r in own})
        ax.set_xticks(sizes, [f"{size}" for size in sizes])
        ax.minorticks_off()
        _plain(ax.yaxis)
        ax.legend(fontsize=7, loc="upper left")
    return figure


def _start_up(ax, rows):
    """Bars of import, compilation and the second solve."""
    pieces = {
        "import_seconds": "import",
        "compile_seconds": "first solve beyond the second",
        "seconds": "second solve",
    }
    names = [row["cache"] for row in rows]
    left = [0.0] * len(rows)
    for key, label in pieces.items():
        values = [row[key] for row in rows]
        ax.barh(names, values, left=left, label=label)
        left = [a + b for a, b in zip(left, values, strict=True)]
    for row, end in zip(rows, left, strict=True):
        ax.text(
            end, row["cache"], f" {row['programs']} programs", va="center", fontsize=8
        )
    ax.set(xlabel="seconds in a fresh process", xlim=(0, 1.3 * max(left)))
    ax.invert_yaxis()
    ax.legend(fontsize=7, loc="lower right")


def peers(rows):
    """Bars of the run time of the sweep."""
    groups = list(dict.fromkeys(row["masses"] for row in rows))
    figure, axes = _axes(1, len(groups), 7.5, 3.2)
    for masses, ax in zip(groups, axes, strict=True):
        own = sorted(
            (r for r in rows if r["masses"] == masses and r.get("seconds")),
            key=lambda r: -r["seconds"],
        )
        for row in own:
            color = (
                "C3"
                if row["code"].startswith("jaxhb")
                else "0.6"
                if row["code"].startswith("numpy")
                else "C0"
            )
            ax.barh(row["code"], 1e3 * row["seconds"], color=color)
            note = f" {1e3 * row['seconds']:.0f} ms, x {row['ratio']:.3g}"
            if row.get("solved", row["speeds"]) < row["speeds"]:
                note += f" (from {row['solved']} speeds)"
            ax.text(1e3 * row["seconds"], row["code"], note, va="center", fontsize=8)
        base = (
            "pyHarm-os"
            if any(r["code"] == "pyHarm-os" for r in own)
            else "numpy, all masses"
        )
        ax.set(
            xscale="log",
            xlabel=f"run time of the sweep of {own[0]['speeds']} speeds in ms",
        )
        ax.set_title(
            f"chain of {masses} masses, one backlash link; x: times as fast as {base}",
            fontsize=9,
        )
        ax.set_xlim(300 * own[-1]["seconds"], 2e5 * own[0]["seconds"])
        _plain(ax.xaxis)
    return figure


def _plain(axis):
    """Ticks of a logarithmic axis as plain numbers, at 1, 2 and 5 where it spans less
    than two decades.
    """
    low, high = axis.get_view_interval()
    axis.set_major_locator(LogLocator(subs=(1, 2, 5) if high < 100 * low else (1,)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.10g}"))
    axis.set_minor_formatter(NullFormatter())


def _axes(rows, columns, width, height):
    """A figure and its axes as a list; :func:`draw` removes those that stay empty."""
    figure = Figure(
        figsize=(columns * width, rows * height + 0.6), layout="constrained", dpi=80
    )
    return figure, list(figure.subplots(rows, columns, squeeze=False).flat)


FIGURES = {"work-precision": work_precision, "scaling": scaling, "peers": peers}


def draw(rows):
    """Name -> Figure of every benchmark that has rows."""
    made = {}
    with matplotlib.rc_context(
        {"axes.grid": True, "grid.color": "0.92", "axes.axisbelow": True}
    ):
        for name, make in FIGURES.items():
            if name in rows:
                figure = make(rows[name])
                for ax in figure.axes:
                    if not ax.has_data():
                        ax.remove()
                made[name.replace("-", "_")] = figure
    return made


def main():
    """Draw what there are rows of."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "rows", nargs="*", help="JSON-lines files; benchmarks/results/*.jsonl"
    )
    parser.add_argument(
        "--to", default=str(FOLDER / "figures"), help="folder for the pictures"
    )
    options = parser.parse_args()
    Path(options.to).mkdir(parents=True, exist_ok=True)
    for name, figure in draw(
        read(options.rows or sorted((FOLDER / "results").glob("*.jsonl")))
    ).items():
        figure.savefig(Path(options.to) / f"{name}.png")
        print(Path(options.to) / f"{name}.png")


if __name__ == "__main__":
    main()
