"""`python -m bench.reference.certify [CASE ...]`: compute the certified values from the files."""

from __future__ import annotations

import json
import sys
from typing import Any

from mpmath import mp

from bench.reference.certify.answers import Certified, certify
from bench.reference.certify.campaign import load
from bench.reference.certify.make import CASES, DRAWN

DIGITS = 15
"""Number of digits written; ten are certified."""


def main() -> None:
    """Certify the cases that are named, or all."""
    for name in sys.argv[1:] or DRAWN:
        found = certify(load(CASES / name))
        text = json.dumps(_written(name, found), indent=1) + "\n"
        (CASES / name / "certified.json").write_text(text, encoding="utf-8")
        print(name, *(_shown(v) for v in found.value))


def _written(name: str, found: Certified) -> dict[str, Any]:
    columns = zip(found.names, found.units, found.value, found.std, strict=True)
    return {
        "case": name,
        "parameters": [
            {"name": n, "unit": u, "value": _shown(v), "std": _shown(s)} for n, u, v, s in columns
        ],
        "sum_of_squares": _shown(found.chi2),
        "degrees_of_freedom": found.dof,
        "checks": {what: _shown(v) for what, v in found.checks.items()},
    }


def _shown(value: Any) -> str | None:
    return None if mp.isnan(value) else str(mp.nstr(value, DIGITS, min_fixed=0, max_fixed=0))


if __name__ == "__main__":
    main()
