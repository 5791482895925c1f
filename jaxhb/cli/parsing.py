"""The argument parser: one sentence per fault, what was probably meant, completion by the shell."""

import argparse
import difflib
import os
import re

from jaxhb.report.files.output import OutputError

SHELLS = "bash", "zsh", "fish", "powershell"

SPEEDS = "--rpm", "--speed", "--speeds"
NO_SPEED = (
    " Natural frequencies do not depend on the speed; --at R takes the teeth as stiff as they are under the mean load"
    " of R rpm."
)


class Parser(argparse.ArgumentParser):
    """An argument parser that says what is wrong in one sentence, what was probably meant, and where help is."""

    _given = ()

    def parse_known_args(self, args=None, namespace=None):
        """As argparse, but a command refuses its unknown options itself: it knows what could be meant."""
        self._given = tuple(args or ())
        found, unknown = super().parse_known_args(args, namespace)
        if unknown and self._subparsers is None:
            self.error(f"unknown argument {unknown[0]}")
        return found, unknown

    def error(self, message):
        """One sentence; an option that is not known is told before one that is missing, which it may stand for."""
        known = self._option_string_actions
        unknown = [word.partition("=")[0] for word in self._given if re.match(r"--[a-z]", word)]
        unknown = [word for word in unknown if word not in known]
        choice = re.search(r"invalid choice: '(.*?)' \(choose from (.*)\)", message)
        if unknown and self._subparsers is None:
            message = f"there is no option {unknown[0]}." + meant(unknown[0], known)
        elif choice and self._subparsers is not None:
            commands = self._subparsers._group_actions[0].choices
            message = f"there is no command {choice[1]!r}." + meant(choice[1], commands, f" Commands: {choice[2]}.")
        message = message.removeprefix("argument ").rstrip(".")
        end = "" if message.endswith("?") else "."
        self.exit(2, f"{self.prog}: {message}{end} See {self.prog} --help\n")


def meant(word, known, otherwise=""):
    """`` Did you mean --rpm?``"""
    if word in SPEEDS:
        if "--rpm" in known:
            return " Did you mean --rpm?"
        if "--at" in known:
            return NO_SPEED
    near = difflib.get_close_matches(word, known, n=1, cutoff=0.6)
    return f" Did you mean {near[0]}?" if near else otherwise


def complete(parser):
    """Answer a shell that asks how a word goes on, and end; nothing where none asks."""
    if "_ARGCOMPLETE" in os.environ:
        import argcomplete

        argcomplete.autocomplete(parser)


def completion(arguments):
    """Print what makes a shell complete commands, options, scenes and names of elements."""
    try:
        import argcomplete
    except ImportError:
        raise OutputError('jaxhb completion needs argcomplete. Install it: pip install "jaxhb[shell]".') from None
    print(argcomplete.shellcode(["jaxhb"], shell=arguments.shell), end="")
    return 0


def of_scenes(prefix, **_):
    """Packaged scenes and files that a word may become."""
    from argcomplete.completers import FilesCompleter

    from jaxhb.scene.files import scene_names

    return [*scene_names(), *FilesCompleter(("toml", "json", "csv"))(prefix)]


def of_elements(*tables):
    """A completer that gives the names of elements of the scene of the line."""

    def complete_names(parsed_args, **_):
        from jaxhb.scene.files import load_scene

        elements = load_scene(parsed_args.scene).topology.elements
        return [name for name, (table, _) in elements.items() if table in tables]

    return complete_names
