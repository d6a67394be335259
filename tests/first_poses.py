"""The FANUC campaign with its first poses only: real readings, and an answer within a second."""

from __future__ import annotations

from pathlib import Path

FANUC = Path(__file__).parents[1] / "data" / "raw" / "fanuc_r2000ic"
TABLES = ("displacements.csv", "forces.csv", "joints.csv")


def first(poses: int, sigma: bool = False) -> dict[str, bytes]:
    """Its files; the noise is stated or must be found."""
    raw = {name: (FANUC / name).read_bytes() for name in ("campaign.toml", *TABLES)}
    for name in TABLES:
        head, *rows = raw[name].decode().splitlines()
        kept = [row for row in rows if int(row.split(",")[0]) <= poses]
        raw[name] = "\n".join([head, *kept, ""]).encode()
    if sigma:
        raw["campaign.toml"] = raw["campaign.toml"].replace(
            b"[joints]", b"sigma_m = 3e-5\n[joints]"
        )
    return raw


def written(folder: Path, poses: int = 8) -> Path:
    """A raw folder with these files."""
    folder.mkdir(parents=True)
    for name, content in first(poses).items():
        (folder / name).write_bytes(content)
    return folder
