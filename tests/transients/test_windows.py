"""Windows of signals over time."""

import numpy as np
import pytest

from jaxhb.transients.history import History


@pytest.mark.parametrize("window", [0.25, 0.4, 5.0])
def test_every_window_of_an_envelope_holds_the_swing_of_a_sine(window):
    time = np.linspace(0.0, 2.0, 4001)
    turned = 2 * np.pi * time
    sine = History(time, np.sin(20 * turned), 0 * time + 60.0, turned)
    envelope = sine.envelope(window)
    assert len(envelope.time) == max(round(2.0 / window), 1)
    # A period has 100 instants, and parabolas find the tops between them.
    assert envelope.highest == pytest.approx(1.0, abs=1e-5)
    assert envelope.lowest == pytest.approx(-1.0, abs=1e-5)
