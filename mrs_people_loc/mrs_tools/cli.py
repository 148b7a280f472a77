"""The `mrs` command.

To add a subcommand, write a function with Typer annotations in a module of `mrs_tools.commands`,
which reads options, calls and prints; add one line to `HEADINGS`, and what one may write to
`examples.EXAMPLES`. The simulator and the studies have the same in their `commands`. Its module is
imported when the subcommand runs, so `mrs --help` stays fast and works without ROS; import ROS
inside functions, so that `mrs NAME --help` does, too.

An error of this project (`PeopleLocError`) is printed as one line and ends with exit code 1, wrong
usage with 2, Ctrl-C with 130, a closed terminal with 129. Everything else is a bug and shows its
traceback.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
import types
import typing
from collections.abc import Callable
from typing import Annotated, Any, NoReturn

from mrs_people_loc.errors import PeopleLocError
from mrs_tools.examples import EXAMPLES, epilog
from mrs_tools.installing import how_to_install

try:
    import typer
    from typer.core import TyperGroup
    from typer.models import OptionInfo
except ModuleNotFoundError as err:
    sys.exit(f"error: mrs needs {err.name}: {how_to_install(str(err.name))}")

from mrs_tools.plain import plain

#: By heading of the help: name: (module:function, what it does). The function may also be a
#: typer.Typer of its own.
HEADINGS = {
    "A team": {
        "up": ("mrs_tools.commands.up:command", "Start every node of a team on this machine."),
        "tour": ("mrs_tools.commands.tour:command", "Guide a group along a tour."),
        "calibrate": (
            "mrs_tools.commands.calibrate:command",
            "Measure a head's mounting by the floor.",
        ),
        "discovery-server": (
            "mrs_tools.commands.discovery_server:command",
            "Let a team find each other without multicast.",
        ),
        "keys": ("mrs_tools.commands.keys:app", "Make hosts members of a team, and revoke them."),
    },
    "What it sees": {
        "view": ("mrs_tools.commands.view:command", "Show a running team in the browser."),
        "people": (
            "mrs_tools.commands.people:command",
            "Show a running team live in the terminal.",
        ),
        "doctor": (
            "mrs_tools.commands.doctor:command",
            "Say what is wrong with a running team, and what to do.",
        ),
    },
    "Recordings": {
        "record": ("mrs_tools.commands.record:command", "Record topics into a bag."),
        "replay": (
            "mrs_tools.commands.replay:command",
            "Publish a bag's messages over ROS, in their timing.",
        ),
    },
}
#: Packages that bring further commands where they are, the same tables in PACKAGE.commands; and
#: the names of these, for who has only heard of them.
FURTHER = {
    "mrs_people_sim": "demo evaluate plot simulate",
    "mrs_studies": "bench convert experiment fit guiding localization real render-suite rooms "
    "suite",
}
for _package in FURTHER:
    if importlib.util.find_spec(_package) is not None:
        _table = importlib.import_module(f"{_package}.commands")
        HEADINGS |= _table.HEADINGS
        EXAMPLES |= _table.EXAMPLES
COMMANDS = {name: entry for commands in HEADINGS.values() for name, entry in commands.items()}

_MISSING = "which is not installed"


class _LazyGroup(TyperGroup):
    """Imports a subcommand when it runs, and turns errors into one line and an exit code."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        for package, names in FURTHER.items():
            if args[0] in names.split() and args[0] not in COMMANDS:
                fail(f"mrs {args[0]} needs {package}, {_MISSING}: {how_to_install(package)}")
        name, command, rest = super().resolve_command(ctx, args)
        return name, _load(name) if name in COMMANDS else command, rest

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            raise typer.Exit(130) from None
        except PeopleLocError as err:
            fail(str(err))
        except ImportError as err:
            module = (err.name or "").partition(".")[0]
            if (how := how_to_install(module)) is None:
                raise
            fail(f"this needs {module}, {_MISSING}: {how}")


def _load(name: str) -> Any:
    """The real subcommand behind a name of `COMMANDS`."""
    path, summary = COMMANDS[name]
    module, _, attribute = path.partition(":")
    target = getattr(importlib.import_module(module), attribute)
    if isinstance(target, typer.Typer):
        target.info.epilog = epilog(name)
        for command in target.registered_commands:
            command.epilog = epilog(f"{name} {command.name}")
            _prepare(command.callback)
    else:
        _prepare(target)
        function, target = target, typer.Typer(add_completion=False, rich_markup_mode="markdown")
        text = None if function.__doc__ else summary
        target.command(name, help=text, epilog=epilog(name))(function)
    return typer.main.get_command(target)


def _prepare(function: Callable[..., object] | None) -> None:
    """Evaluate annotations, write `X | None` as Optional[X], and let flags show no type.

    Ubuntu 24.04's Typer (0.9) does not do the first and does not understand the second; newer ones
    show `<bool>` beside a flag, as if it took a value.
    """
    if function is None:
        return
    hints = typing.get_type_hints(function, include_extras=True)
    for name, hint in hints.items():
        if typing.get_origin(hint) is Annotated:
            plain, *notes = typing.get_args(hint)
            if isinstance(plain, types.UnionType):
                plain = typing.Union[typing.get_args(plain)]  # noqa: UP007
                hints[name] = Annotated[(plain, *notes)]
            if bool in (plain, *typing.get_args(plain)):
                for option in (note for note in notes if isinstance(note, OptionInfo)):
                    option.metavar = ""
    function.__annotations__ = hints


def fail(message: str) -> NoReturn:
    """Print an error and leave with exit code 1."""
    from rich.console import Console
    from rich.text import Text

    lines = "\n".join(map(plain, message.split("\n")))
    line = Text.assemble(("error: ", "bold red"), lines)
    Console(stderr=True, soft_wrap=True).print(line)
    raise typer.Exit(1)


app = typer.Typer(
    name="mrs",
    cls=_LazyGroup,
    help="Several robots with stereo heads find people on one common map.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",  # in "rich", a unit such as [s] would be taken for markup
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from mrs_people_loc import __version__

        print(f"mrs {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Say the version."),
    ] = False,
) -> None:
    pass


_prepare(_options)
for _heading, _commands in HEADINGS.items():
    for _name, (_path, _summary) in _commands.items():
        # A stand-in for the list of subcommands; _LazyGroup puts the real one in its place.
        app.command(_name, help=_summary, rich_help_panel=_heading)(lambda: None)


def main() -> None:
    """Run the `mrs` command."""
    sys.exit(app(prog_name="mrs"))
