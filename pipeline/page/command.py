"""`pipeline page`: campaigns from files to the report in a browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from typer import Option

from pipeline.app.commands._shared import Root
from pipeline.base.errors import UsageError


def page(
    port: Annotated[int, Option(min=1024, max=65535, help="Port on this machine.")] = 4203,
    opened: Annotated[
        bool, Option("--open/--no-open", help="Open the page in the browser at once.")
    ] = False,
    root: Root = Path(),
) -> None:
    """Bring campaigns from their files to the report in a browser, on this machine alone.

    The address has a token in it: whoever has it may do what you may with the project's campaigns.
    """
    from pipeline.page.server import serve

    if not root.is_dir():
        raise UsageError(f"there is no folder {root}: correct --root")
    serve(root, port, typer.echo, opened)
