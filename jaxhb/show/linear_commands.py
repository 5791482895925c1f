"""What the commands of the linear train do: compute, print for people, write for programs."""

import sys

from ..linear.forced import forced_response
from ..linear.modal import natural_frequencies
from .forced import forced_failures, forced_record, forced_rows, forced_text, readings
from .output import ANSWERED, NOT_ANSWERED, as_csv, as_json, as_picture, changes, deliver
from .record import finite, modes_record
from .tables import modes_text


def modes(train, arguments):
    """Natural frequencies of a scene."""
    found = natural_frequencies(train)
    deliver(
        arguments,
        modes_text(found, train.topology.name),
        json=lambda: as_json(changes(arguments) | modes_record(found)),
    )
    return ANSWERED


def forced(train, arguments):
    """Linear forced response over the speed."""
    response = forced_response(train.misfire(*arguments.misfire), rpm=arguments.rpm)
    found = readings(response, arguments.element)
    deliver(
        arguments,
        forced_text(response, found, each=bool(arguments.element)),
        json=lambda: as_json(finite(changes(arguments) | forced_record(response, found, orders=arguments.orders))),
        csv=lambda: as_csv(*map(finite, forced_rows(response, found))),
        plot=lambda: _forced_picture(arguments, response, found),
    )
    failures = forced_failures(response)
    for sentence in failures:
        print(sentence, file=sys.stderr)
    return NOT_ANSWERED if failures else ANSWERED


def _forced_picture(arguments, response, found):
    from .forced_plots import plot_forced

    return as_picture(arguments.plot, plot_forced(response, found))
