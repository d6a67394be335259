"""How it was done: method, assumptions, inputs, versions."""

from __future__ import annotations

from pipeline.base.quantities import MISSING, known, plain, typeset
from pipeline.report.record import Column, Entry, Section, Table, Text, entry, text_entry
from pipeline.report.sections._tree import at, items
from pipeline.report.summaries import Result

_LEFT_OUT = (
    " and is left out of c = B x; where the noise is stated or found in repeats, the "
    "uncertainties hold it."
)

_METHOD = (
    "Loaded minus unloaded reflector positions c, Eq. (20), are explained by one linear spring per "
    "joint, c = B x with the compliances x, Eqs. (6), (7), (19). The compliances come from "
    "generalised least squares with the full covariance of c: tracker noise per reading, the zero "
    "shared by all pulls of a pose, the force reading that moves all coordinates of a pull "
    "together, the direction of the chain and the registration. The force acts along the chain, "
    "Eqs. (10), (11). Validation leaves out one pose with all its pulls at a time."
)


def method(result: Result) -> Section:
    """How the stiffnesses were made, and from what."""
    equilibrium = at(result, "model", "equilibrium")
    said = _METHOD
    if equilibrium == "deformed":
        said += " The force acts on the deflected robot (second order in the load)."
    elif equilibrium == "undeformed":
        said += " The geometry is that of the unloaded robot."
    if at(result, "recommended", "model") in ("extended", "averaged"):
        said += " Beside the springs the model holds what was identified, c = B x + Z z."
    second = at(result, "fit", "second_order_rms_mm")
    if known(second):
        said += f" The second order in the load amounts to {plain(second, 2)} mm rms"
        said += "." if equilibrium == "deformed" else _LEFT_OUT
    blocks = [Text(said), _assumptions(result), _inputs(result), _versions(result)]
    return Section(
        "method",
        "Method, assumptions, versions, inputs",
        tuple(block for block in blocks if block is not None),
    )


def _assumptions(result: Result) -> Table | None:
    rows = [(text_entry(typeset(str(a))),) for a in items(result, "assumptions")]
    return Table("assumptions", "Assumptions", (Column("Assumed"),), tuple(rows)) if rows else None


def _inputs(result: Result) -> Table | None:
    rows = [
        (
            text_entry(i.get("file")),
            entry(str(i.get("bytes")), i.get("bytes")) if known(i.get("bytes")) else Entry(MISSING),
            text_entry(i.get("sha256")),
        )
        for i in items(result, "inputs")
    ]
    columns = (
        Column("File", code=True),
        Column("Bytes", numeric=True),
        Column("SHA-256", code=True),
    )
    return Table("inputs", "Input files", columns, tuple(rows)) if rows else None


def _versions(result: Result) -> Text | None:
    versions = result.get("versions") or {}
    said = ", ".join(f"{name} {version}" for name, version in versions.items())
    return Text(f"Computed with {said}.") if said else None
