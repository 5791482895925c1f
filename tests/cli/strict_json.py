"""How tests read the JSON files of the commands."""

import json


def read(path):
    """JSON as a strict reader takes it: no NaN, no Infinity."""

    def refuse(word):
        raise ValueError(f"{word} is no JSON")

    return json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)
