"""`make supply`: installed packages, their licences and known vulnerabilities; reproducible wheel.

Writes build/bom.json, a bill of materials (CycloneDX 1.6) of the environment that requirements.lock
builds. The tools for it are fetched for this command alone. Exits with 1 if a licence forbids our
use, an advisory applies, or two wheels differ; what could not be read is reported.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
BOM = ROOT / "build" / "bom.json"

_COMPATIBLE = (
    "MIT", "BSD", "Apache", "ISC", "Zlib", "0BSD", "CC0", "PSF", "Python-2.0", "CNRI", "BSL-1.0",
    "HPND", "Unlicense", "OSI Approved :: MIT", "Artistic", "DFSG",
    "MPL", "Mozilla", "LGPL", "Lesser",
)  # fmt: skip
"""Words of licences whose code may be imported by code under Apache-2.0. The last four require
changes to their own files to be published; we change none and ship none."""


def run(*command: str) -> subprocess.CompletedProcess[str]:
    """Run a command; return its exit code and output."""
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


def tool(package: str, *command: str) -> subprocess.CompletedProcess[str]:
    """Run a command of a package that is fetched for it."""
    return run(str(Path(sys.executable).parent / "uv"), "tool", "run", "--from", package, *command)


def bill() -> list[dict[str, Any]]:
    """Every component of the environment, also written to `BOM`."""
    BOM.parent.mkdir(exist_ok=True)
    made = tool(
        "cyclonedx-bom", "cyclonedx-py", "environment", sys.executable, "--output-reproducible",
        "--pyproject", "pyproject.toml", "-o", str(BOM),
    )  # fmt: skip
    if made.returncode:
        sys.exit(f"no bill of materials: {made.stderr.strip()[-300:]}")
    return list(json.loads(BOM.read_text("utf-8"))["components"])


def licences(component: dict[str, Any]) -> list[str]:
    """Licences of a component, by identifier or name; several are alternatives or all apply."""
    said = component.get("licenses", [])
    found = [
        one.get("expression") or one["license"].get("id") or one["license"].get("name", "")
        for one in said
    ]
    return sorted(set(found))


def forbidden(said: list[str]) -> bool:
    """Whether a component states licences and none of them is compatible."""
    return bool(said) and not any(word in one for one in said for word in _COMPATIBLE)


def audited() -> tuple[int, int, list[str]]:
    """Numbers of packages with and without advisories read, and the advisories found."""
    asked = ("--disable-pip", "--require-hashes", "-r", "requirements.lock", "-f", "json")
    end = tool("pip-audit", "pip-audit", *asked)
    try:
        packages = json.loads(end.stdout)["dependencies"]
    except ValueError:
        return 0, 0, []
    read = [one for one in packages if "vulns" in one]
    bad = [f"{one['name']} {one['version']}: {v['id']}" for one in read for v in one["vulns"]]
    return len(read), len(packages) - len(read), bad


def wheel(folder: Path) -> str:
    """SHA-256 of the wheel built into a folder."""
    shutil.rmtree(ROOT / "build" / "lib", ignore_errors=True)  # it may keep moved modules
    pip = (sys.executable, "-m", "pip", "-qq", "wheel", "--no-deps", "--no-build-isolation")
    end = run(*pip, "--no-index", "--wheel-dir", str(folder), ".")
    if end.returncode:
        sys.exit(f"no wheel: {end.stderr.strip()[-300:]}")
    return hashlib.sha256(next(folder.glob("*.whl")).read_bytes()).hexdigest()


def main() -> None:
    """Print all four."""
    parts = bill()
    stated = [(part["name"], part["version"], licences(part)) for part in parts]
    bad = [one for one in stated if forbidden(one[2])]
    silent = [f"{name} {version}" for name, version, said in stated if not said]
    print(f"{len(parts)} components, {BOM.relative_to(ROOT)}")
    print(f"licences: {len(bad)} forbid the use, {len(silent)} state none {', '.join(silent)}")
    for name, version, said in bad:
        print(f"  {name} {version}: {', '.join(said)}")
    read, unread, known = audited()
    print(f"advisories: {read} packages read, {unread} not, {len(known)} known weaknesses")
    for one in known:
        print(f"  {one}")
    with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as two:
        same = wheel(Path(one)) == wheel(Path(two))
    print("two wheels of this tree are " + ("the same" if same else "not the same"))
    sys.exit(bool(bad or known or not same))


if __name__ == "__main__":
    main()
