"""Rows of the benchmarks: one core, versions, medians over repeats, JSON lines, a table
for people.
"""

import argparse
import contextlib
import json
import os
import platform
import resource
import statistics
import sys
import time
from importlib import metadata
from pathlib import Path

import jax
import numpy as np

BLAS_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def pin(core):
    """Keep this process on one core; called before anything is computed, so that JAX
    starts one thread.

    BLAS has made its threads when it was imported, and several on one core wait for
    each other (a singular value decomposition of 300 disks took 0.7 s instead of 0.03
    s): the process begins anew with one.
    """
    if core < 0 or not hasattr(os, "sched_setaffinity"):
        return
    os.sched_setaffinity(0, {core})
    if any(os.environ.get(name) != "1" for name in BLAS_THREADS):
        os.environ.update(dict.fromkeys(BLAS_THREADS, "1"))
        os.execv(sys.executable, [sys.executable, *sys.orig_argv[1:]])


def versions():
    """Versions of what is compared, "" where a package is not installed."""
    found = {"python": platform.python_version()}
    for package in (
        "jax",
        "jaxlib",
        "jaxhb",
        "numba",
        "numpy",
        "scipy",
        "diffrax",
        "opentorsion",
    ):
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = ""
    return found


def device():
    """What the rows were measured on."""
    model = platform.processor() or platform.machine()
    listed = Path("/proc/cpuinfo")
    if listed.exists():
        names = [
            line.partition(":")[2].strip()
            for line in listed.read_text().splitlines()
            if "model name" in line
        ]
        model = names[0] if names else model
    return {
        "cpu": model,
        "cores": len(os.sched_getaffinity(0)),
        "jax": str(jax.devices()[0]),
    }


def forget_peak():
    """Start the peak of the resident memory anew, where the system can (Linux)."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def peak_memory():
    """Largest resident memory of this process since :func:`forget_peak` (else since it
    began), MiB.
    """
    listed = Path("/proc/self/status")
    if listed.exists():
        return next(
            int(line.split()[1]) / 1024
            for line in listed.read_text().splitlines()
            if "VmHWM" in line
        )
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return used / 2**20 if sys.platform == "darwin" else used / 1024


def exponent(sizes, seconds):
    """Slope of log time over log size by least squares; nan for fewer than two
    points.
    """
    if len(sizes) < 2:
        return float("nan")
    return float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])


def timed(call, repeats, enough=30.0):
    """First call and the others: (result, seconds of the first, median of the others,
    their spread max - min).

    Repeats end, after one of them, when they have taken ``enough`` seconds.
    """
    begin = time.perf_counter()
    result = call()
    first = time.perf_counter() - begin
    runs = []
    while len(runs) < repeats and (not runs or sum(runs) < enough):
        begin = time.perf_counter()
        result = call()
        runs.append(time.perf_counter() - begin)
    return result, first, statistics.median(runs), max(runs) - min(runs)


class Recorder:
    """Prints ``columns`` (name -> format) of rows as they come and writes rows as JSON
    lines to a path, if any.

    Numbers that are not finite become null.
    """

    def __init__(self, benchmark, path, columns):
        self.common = {
            "benchmark": benchmark,
            "device": device(),
            "versions": versions(),
        }
        self.file = Path(path).open("w") if path else None  # noqa: SIM115
        self.columns = columns
        self.rows = []

    def head(self):
        """Print the names of the columns."""
        print(
            "  ".join(
                f"{name:{_align(form)}{_width(form)}}"
                for name, form in self.columns.items()
            ),
            flush=True,
        )

    def add(self, **row):
        """One measurement."""
        self.rows.append(row)
        cells = [_cell(row.get(name), form) for name, form in self.columns.items()]
        print("  ".join(cells), flush=True)
        if self.file:
            self.file.write(
                json.dumps(
                    _plain({**self.common, "load_average": os.getloadavg()[0], **row})
                )
                + "\n"
            )
            self.file.flush()


def command_line(doc, *, core=None, repeats=None, quick=""):
    """The reader of a command line that shows the docstring of its script, with the
    options that are asked for.
    """
    parser = argparse.ArgumentParser(
        description=doc, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", metavar="FILE", help="file for JSON lines")
    if core is not None:
        parser.add_argument(
            "--core", type=int, default=core, help="the core to stay on; -1: any"
        )
    if repeats:
        parser.add_argument("--repeats", type=int, default=repeats)
    if quick:
        parser.add_argument("--quick", action="store_true", help=quick)
    return parser


def started(benchmark, options, columns):
    """The Recorder of a benchmark on its core, with the names of the columns
    printed.
    """
    pin(options.core)
    recorder = Recorder(benchmark, options.json, columns)
    recorder.head()
    return recorder


def run_parts(benchmark, parser, parts, columns):
    """Run the parts of a benchmark that the command line names, all by default:
    functions of (Recorder, options).
    """
    parser.add_argument(
        "parts",
        nargs="*",
        metavar="part",
        help=f"{', '.join(parts)}; default: all",
        default=[],
    )
    options = parser.parse_args()
    if unknown := sorted(set(options.parts) - set(parts)):
        parser.error(f"unknown parts {unknown}: give {', '.join(parts)}")
    recorder = started(benchmark, options, columns)
    for part in options.parts or parts:
        parts[part](recorder, options)


def _align(form):
    return form[0] if form[0] in "<>" else ">"


def _width(form):
    return int(form.lstrip("<>").partition(".")[0].rstrip("dgfse"))


def _cell(value, form):
    if value is None or (isinstance(value, float) and not np.isfinite(value)):
        return f"{'-':>{_width(form)}}"
    return format(value, form)


def _plain(value):
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not np.isfinite(value) else value


def cases_line(doc, seed, cases=200):
    """The command line of a benchmark whose random cases are run one after another, its
    file appended to.
    """
    read = command_line(doc)
    read.add_argument("--cases", type=int, default=cases)
    read.add_argument("--seed", type=int, default=seed)
    read.add_argument("--only", type=int, help="this case alone")
    return read


def run_cases(asked, benchmark, run_case):
    """Records of the cases asked for, each printed and kept as soon as it is known.

    In the order in which they are drawn: where a run is cut off, what it has is a fair
    sample. Cases of the same seed that the file holds are not run again. ``run_case``
    makes a record from the seed and number of a case.
    """
    file = Path(asked.json) if asked.json else None
    rows = (
        [json.loads(text) for text in file.read_text().splitlines()]
        if file and file.exists()
        else []
    )
    records = [
        r for r in rows if r.get("seed") == asked.seed and r["case"] < asked.cases
    ]
    known = {r["case"] for r in records}
    if file and not rows:
        file.write_text(
            json.dumps(
                {"benchmark": benchmark, "device": device(), "versions": versions()}
            )
            + "\n"
        )
    for index in range(asked.cases) if asked.only is None else [asked.only]:
        if index in known:
            continue
        records.append({"benchmark": benchmark} | run_case(asked.seed, index))
        print(json.dumps(records[-1]), flush=True)
        if file:
            with file.open("a") as stream:
                stream.write(json.dumps(records[-1]) + "\n")
    return records
