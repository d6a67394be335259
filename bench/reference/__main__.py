"""`python -m bench.reference`: number of digits in which answers agree with certified ones."""

from __future__ import annotations

from typing import Annotated

import typer

from pipeline.app import cli

command = typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None)


@command.command()
def reference(
    answer: Annotated[
        bool, typer.Option("--answer", help="How far result.json is from them, too [u].")
    ] = False,
) -> None:
    """Print the log relative errors of all reference campaigns."""
    from bench.reference.lre import agreement, away, names

    more = " result.json, u |" if answer else ""
    typer.echo(f"| case | value | standard uncertainty | sum of squares |{more}")
    typer.echo("|---" * (5 if answer else 4) + "|")
    for name in names():
        one = agreement(name)
        digits = f"| {name} | {one.value:.1f} | {one.std:.1f} | {one.squares:.1f} |"
        far = "-" if name == "placing" else f"{away(name):.2g}" if answer else ""
        typer.echo(f"{digits} {far} |" if answer else digits)


if __name__ == "__main__":
    cli.main(app=command, name="python -m bench.reference")
