"""What a command and an option of this program are, beyond those of click."""

import itertools

import click

SPEEDS = "--rpm", "--speed", "--speeds"
NO_SPEED = (
    "Natural frequencies do not depend on the speed; --at R takes the teeth as stiff as they are under the mean load of"
    " R rpm."
)


class Program(click.Group):
    """Commands in the order in which they are defined; the help ends with the examples of all."""

    def list_commands(self, ctx):
        """Their names."""
        return list(self.commands)

    def format_epilog(self, ctx, formatter):
        """Examples and exit status."""
        shown = [line for one in self.commands.values() for line in one.epilog.splitlines() if "  jaxhb " in line]
        formatter.write("\n".join(["", "Examples:", *shown, ""]))
        super().format_epilog(ctx, formatter)


class Command(click.Command):
    """A command that never takes an option for a value, and knows what words for a speed may stand for."""

    def parse_args(self, ctx, args):
        """As click, but for that; every fault knows its command."""
        named = {name: one for one in self.params if isinstance(one, click.Option) for name in one.opts}
        valued = {name for name, one in named.items() if not one.is_flag}
        if ctx.resilient_parsing and args and args[-1] in valued:
            args = args[:-1]  # its value is being completed, by the scene, of which click would not know then
        try:
            for word, following in itertools.pairwise([] if ctx.resilient_parsing else args):
                if word in valued and following.startswith("--"):
                    raise click.BadOptionUsage(word, f"Option {word!r} requires an argument.")
            return super().parse_args(ctx, _one_by_one(args, named))
        except click.UsageError as fault:
            fault.ctx = fault.ctx or ctx
            meant = "Did you mean '--rpm'?" if "--rpm" in named else NO_SPEED if "--at" in named else ""
            if meant and isinstance(fault, click.NoSuchOption) and fault.option_name in SPEEDS:
                raise click.NoSuchOption(fault.option_name, f"{fault.message} {meant}", ctx=ctx) from None
            raise


def _one_by_one(args, named):
    """The words, those of an option with several values as ``--mode 1 --mode 2``."""
    words, several = [], None
    for word in args:
        if word.startswith("--"):
            several = word if isinstance(named.get(word), Several) else None
        elif several and words[-1] != several:
            words.append(several)
        words.append(word)
    return words


class Several(click.Option):
    """An option with one or more values: ``--mode 1 2``."""

    def __init__(self, *given, **more):
        super().__init__(*given, multiple=True, **more)


class Value(click.ParamType):
    """What a function reads from a word; its ValueError says what is wrong."""

    def __init__(self, read):
        self.read, self.name = read, read.__name__

    def convert(self, value, param, ctx):
        """As the function reads it; a default is a value already."""
        if not isinstance(value, str):
            return value
        try:
            return self.read(value)
        except ValueError as error:
            return self.fail(str(error), param, ctx)


def option(spelled, text, read=None, *, to=None, **more):
    """An option as its help spells it, ``--rpm A:B:COUNT``; without a second word it is a switch.

    Parameters
    ----------
    spelled : str
    text : str, the help
    read : function of a word, or sequence of the words to choose from, optional
        By default words are taken as they are, and where they name files the shell completes them.
    to : str, optional
        Name of the argument, by default that of the option.
    **more
        Of :class:`click.Option`.
    """
    name, _, metavar = spelled.partition(" ")
    if not metavar:
        more["is_flag"] = True
    elif metavar.startswith(("FILE", "DIR")):
        more["type"] = click.Path()
    elif read is not None:
        more["type"] = Value(read) if callable(read) else click.Choice(read)
    return click.option(*filter(None, (name, to)), metavar=metavar or None, help=text, **more)


def together(*options):
    """One decorator of several options, shown in this order."""

    def decorate(function):
        for one in reversed(options):
            function = one(function)
        return function

    return decorate
