"""Sentences on what is wrong: the error that carries them, values as they quote them,
and what was probably meant.
"""

import difflib
import math
from collections.abc import Iterable
from typing import Any

MOST_SENTENCES = 12  # of an error that are printed
LONGEST_SENTENCE = 1000  # characters that are printed of each


class SceneError(ValueError):
    """Everything wrong with a scene or with a request to change it, one sentence a
    line.

    ``sentences`` holds all; its text the first dozen and the number of the rest.
    """

    def __init__(self, sentences: str | Iterable[str]) -> None:
        self.sentences = (
            (sentences,) if isinstance(sentences, str) else tuple(sentences)
        )
        left_out = len(self.sentences) - MOST_SENTENCES
        printed = self.sentences[: MOST_SENTENCES if left_out > 1 else None]
        lines = [cut(text, LONGEST_SENTENCE) for text in printed]
        if left_out > 1:
            lines.append(f"... and {left_out} more faults.")
        super().__init__("\n".join(lines))


QUOTED = 60  # characters of a value that a sentence quotes


def shown(value: Any) -> str:
    """Write a value as a sentence quotes it, cut after :data:`QUOTED` characters."""
    # Beyond float64; and repr refuses more than 4300 digits.
    if isinstance(value, int) and value.bit_length() > 1023:
        digits = int(value.bit_length() * math.log10(2.0)) + 1
        return f"an integer of about {digits} digits"
    # Cut before it is written: a long list would be written whole.
    quoted = value[: QUOTED + 1] if isinstance(value, str | list | tuple) else value
    try:
        text = repr(quoted)
    except ValueError:
        return "a value too long to be written"
    return text if len(text) <= QUOTED + 2 else f"{text[:QUOTED]}…"


def cut(text: str, most: int = 4 * QUOTED) -> str:
    """Shorten a text that stands in a sentence without quotes, as a path or the message
    of a library.
    """
    return text if len(text) <= most else f"{text[:most]}…"


def suggestion(word: Any, choices: Iterable[str]) -> str:
    """Say what was probably meant: `` Did you mean 'stiffness'?``, or the choices where
    nothing is near.
    """
    words = list(choices)
    near = nearest(word, words)
    if near or not words:
        return near
    listed = ", ".join(map(shown, words[:8]))
    return f" Known: {listed}{', …' if len(words) > 8 else ''}."


def nearest(word: Any, choices: Iterable[str]) -> str:
    """Say what was probably meant, nothing where no choice is near."""
    near = difflib.get_close_matches(
        word if isinstance(word, str) else "", choices, n=1, cutoff=0.6
    )
    return f" Did you mean {shown(near[0])}?" if near else ""


class Suggestions:
    """Suggest by :func:`suggestion` for the first :data:`MOST_SENTENCES` unknown words:
    each is compared with all names of a scene.
    """

    def __init__(self, choices: Iterable[str]) -> None:
        self._choices = list(choices)
        self._left = MOST_SENTENCES

    def __call__(self, word: Any) -> str:
        self._left -= 1
        return suggestion(word, self._choices) if self._left >= 0 else ""
