"""Completion by the shell: what is proposed for scenes and names of elements, and names with spaces in bash."""

import os
import re

from click.shell_completion import BashComplete, CompletionItem, add_completion_class


@add_completion_class
class QuotingBash(BashComplete):
    """Names such as ``cylinder A1``: where no quote was typed, what bash would split stands after backslashes."""

    def format_completion(self, item):
        """One line; bash takes one backslash away when it reads it."""
        typed = os.environ["COMP_WORDS"].split("\n")[int(os.environ["COMP_CWORD"]) :]
        quoted = typed and typed[0].startswith(("'", '"'))
        value = item.value if quoted else re.sub(r"([^\w./~@%+:=,-])", r"\\\1", item.value)
        return f"{item.type},{value}".replace("\\", "\\\\")


def of_scenes(context, parameter, begun):
    """Packaged scenes that a word may become, and files where it becomes none."""
    from jaxhb.scene.files import scene_names

    names = [CompletionItem(name) for name in scene_names() if name.startswith(begun)]
    return [CompletionItem(begun, type="file"), *names]


def of_elements(*tables):
    """What proposes the names of elements of the scene of the line."""

    def names(context, parameter, begun):
        from jaxhb.elements.elements import SceneError
        from jaxhb.scene.files import load_scene

        try:
            elements = load_scene(context.params["scene"]).topology.elements
        except (SceneError, OSError, TypeError):  # there is none on the line, or none that can be read
            return []
        return [name for name, (table, _) in elements.items() if table in tables and name.startswith(begun)]

    return names
