"""Widths of texts in Arial, Helvetica and the fonts that browsers put in their place,
which have the same: legends, names and titles get as much room as they take.
"""

WIDTHS = {
    222: "ijl'",
    260: "|",
    278: " !,./:;I[]\\ft",
    333: "()-`r{}",
    355: '"',
    389: "*",
    469: "^",
    500: "Jckvsxyz",
    556: "#$0123456789?L_abdeghnopqu",
    584: "+<=>~",
    611: "FTZ",
    667: "&ABEKPSVXY",
    722: "CDHNRUw",
    778: "GOQ",
    833: "Mm",
    889: "%",
    944: "W",
    1015: "@",
}
"""Letters by their widths in thousandths of the size of the font."""

OTHER = 650  # letters of other alphabets, thousandths
_OF_LETTER = {letter: width for width, letters in WIDTHS.items() for letter in letters}


def width_of(text: str, size: float) -> float:
    """Pixels that a text takes in a line, with letters of a ``size`` in pixels.

    >>> round(width_of("torque, kN m", 10.0), 1)
    57.2
    """
    return 1e-3 * size * sum(_OF_LETTER.get(letter, OTHER) for letter in text)
