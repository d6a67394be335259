"""Commands for new files: recognise them, and write the campaign.toml for them."""

from __future__ import annotations

import contextlib
import math
import re
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from posixpath import dirname
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from pipeline.app.commands._shared import (
    AsJson,
    Root,
    fitted,
    show,
)
from pipeline.base.doors import opened as behind
from pipeline.base.errors import UsageError, listed
from pipeline.base.patterns import is_glob
from pipeline.base.shown import typed

if TYPE_CHECKING:  # they import the numerical libraries, which takes a second
    from pipeline.intake.blank import KnownData
    from pipeline.intake.files import FilesProposal
    from pipeline.readers import ExportSettings

_USUAL = "kr500_rail"
"""Default robot of a campaign that has no files yet."""

_OPEN = "Enter leaves it open"


def init(
    name: Annotated[
        str | None, Argument(metavar="NAME", help="Name of the campaign and of its folder.")
    ] = None,
    robot: Annotated[str | None, Option(help="Name of a built-in robot, or a robot file.")] = None,
    plan: Annotated[
        Path | None, Option(help="Take poses, load steps and tool from this plan file.")
    ] = None,
    stated: Annotated[
        Path | None,
        Option(metavar="TOML", help="A campaign.toml whose [tracker] says how exports are read."),
    ] = None,
    root: Root = Path(),
) -> None:
    """Set up a campaign: write campaign.toml for the files in its folder, or for none yet.

    On a terminal it asks for whatever the files do not say.
    """
    from pipeline.intake import blank

    ask = sys.stdin.isatty()
    if name is None and not ask:
        raise UsageError("the campaign has no name: write `pipeline init NAME`")
    if name is None:
        name = str(typer.prompt(f"Name of the campaign ({blank.FOLDER_NAME})", err=True))
    folder = blank.vacant(root, name)
    if plan is None:
        _propose(root, folder, robot, stated, ask)
    elif robot is not None:
        raise UsageError("the plan names its robot: leave out --robot, or --plan")
    elif folder.exists():
        raise UsageError(f"{folder} is there already: choose another name")
    else:
        behind("pipeline.simulate.command:prepare")(folder, plan)
        typer.echo(folder)
        _tell("joints.csv has the poses of the plan, loads.csv its load steps without forces.")
        _tell("Next: measure; write the scale's readings into loads.csv, put the tracker's export "
              "beside it, fill in [base_frame] of campaign.toml, then "
              f"pipeline check {typed(folder.name)}")  # fmt: skip


def _all_known(
    proposal: FilesProposal, robot: str | None, given: KnownData, ask: bool
) -> KnownData:
    """Data from a filled-in sheet, and from a person if one can be asked."""
    if ask:
        return _asked(proposal, robot, given)
    return replace(given, robot=robot, instrument=given.words.get("instrument.model"))


def _propose(root: Path, folder: Path, robot: str | None, stated: Path | None, ask: bool) -> None:
    """Write campaign.toml for the files in the folder, with known or asked data."""
    from pipeline.intake import blank
    from pipeline.intake._folder import in_workbooks, pages, robots_in
    from pipeline.intake._slides import MADE, with_slides
    from pipeline.intake.files import propose
    from pipeline.intake.filled import filled_in

    robot, stated = _before(root, folder, robot, stated)
    hints = _stated(stated)
    files, passed = _looked_at(root, folder, hints)
    slides = with_slides(files)
    files, passed = slides.files, [*passed, *slides.said]
    if slides.made:
        (folder / MADE).write_bytes(slides.made)
    given, wrong = filled_in(files)
    files, named = _as_named(root, folder, files, hints)
    proposal = _settled(files, hints) if ask else propose(files, hints)
    proposal = replace(proposal, patterns=named or proposal.patterns)
    given = _with_places(given, proposal)
    others = {*proposal.exports, proposal.loads, proposal.joints, *proposal.refused}
    robots = [] if robot else robots_in(files, others)
    for line in [*_seen(proposal), *pages(files), *in_workbooks(files), *robots, *passed, *wrong]:
        _tell(line)
    if robot is None:
        robot = _named(root, folder, given) or _robot(root, folder, proposal, files, ask)
    if robot is None:
        _propose_rail(folder, proposal, files)
    known = _all_known(proposal, robot, given, ask)
    if made := blank.simulated(root, folder.name, files):
        known = replace(known, simulated=True)
        _tell(f"{listed(made)} are those of the rehearsal: campaign.toml says simulated = true.")
    left = blank.write(folder, proposal, known)
    typer.echo(folder)
    _tell_next(folder, proposal, left)


def _before(
    root: Path, folder: Path, robot: str | None, stated: Path | None
) -> tuple[str | None, Path | None]:
    """The robot and the file of statements, from an open campaign.toml where no option has them."""
    from pipeline.intake import blank

    if robot is not None:
        robot = blank.brought(folder, robot)
        blank.known(root, folder.name, robot)
    if old := blank.open_text(folder):
        stated = stated or folder / "campaign.toml"
        robot = robot or _robot_before(root, folder, old)
        _tell("campaign.toml is written again for the files that are there; what was filled in "
              "beside the names of logs is kept.")  # fmt: skip
    return robot, stated


def _tell_next(folder: Path, proposal: FilesProposal, left: Sequence[str]) -> None:
    """Show what is still open in campaign.toml, and the next command."""
    if proposal.nothing:
        _tell("No exports or logs lie there yet. To have campaign.toml written for files of other "
              "programs, copy them there and type "
              f"`pipeline init {typed(folder.name)}` again.")  # fmt: skip
    todo = f"Still open in campaign.toml: {listed(left, most=40)}; fill it in, then" if left else ""
    _tell(f"{todo or 'Next'}: pipeline check {typed(folder.name)}")


def _looked_at(
    root: Path, folder: Path, hints: ExportSettings
) -> tuple[dict[str, bytes], list[str]]:
    """The files of a campaign, and a sentence for each inner folder that is not looked at.

    Inner folders are looked at if no export lies in the campaign's own, or only files that tell
    less than those in the folders, such as a sketch of places.
    """
    from pipeline.dialects.taught import gathered
    from pipeline.intake import blank
    from pipeline.intake.files import propose
    from pipeline.store.campaign import DEEPEST

    files, within = gathered(blank.there(root, folder)), blank.inner(folder)
    if not within:
        return files, []
    own = propose(files, hints)
    if not (own.measured and own.joints):
        every = gathered(blank.there(root, folder, DEEPEST))
        if not own.measured and (not own.exports or propose(every, hints).measured):
            return every, []
        files |= {name: every[name] for name in every if is_glob(name)}
        within -= Counter({dirname(name): within[dirname(name)] for name in files})
    return files, [_passed(inner, count) for inner, count in within.items()]


def _passed(inner: str, count: int) -> str:
    return (
        f"{inner}: {count} {'file is' if count == 1 else 'files are'} in this folder and not "
        f'looked at; campaign.toml may name them, as in files = ["{inner}/*.csv"].'
    )


def _as_named(
    root: Path, folder: Path, files: dict[str, bytes], hints: ExportSettings
) -> tuple[dict[str, bytes], tuple[str, ...]]:
    """The files without exports that an open campaign.toml leaves out, and how it names the others.

    As they are where it names what `init` would write for some of them: others came later.
    """
    from pipeline.base.patterns import fits
    from pipeline.intake import blank
    from pipeline.intake.files import patterns, propose
    from pipeline.store.campaign import DEEPEST

    tracker = _tracker(blank.open_text(folder), "campaign.toml")
    named = tuple(map(str, tracker.get("files", ())))
    every = {**blank.there(root, folder, DEEPEST), **files} if named else {}
    mine = [name for name in every if any(fits(name, one) for one in named)]
    if not mine:
        return files, ()
    found = {*propose(files, hints).exports}
    if found.issuperset(mine) and patterns(mine, [*every]) == named:
        return files, ()
    wanted = {*mine} | (files.keys() - found)
    kept = {name: data for name, data in every.items() if name in wanted}
    return (kept, named) if {*propose(kept, hints).exports} == {*mine} else (files, ())


def _with_places(given: KnownData, proposal: FilesProposal) -> KnownData:
    """The known data with the nominal places of other files, as far as it has none."""
    found = proposal.nominal
    source = {name: why for name, why in found.source.items() if name not in given.places}
    return replace(given, places={**found.places, **given.places}, source=source)


def _named(root: Path, folder: Path, given: KnownData) -> str | None:
    """The robot named in a filled-in sheet, if its file is there."""
    from pipeline.intake import blank

    name = given.words.get("robot", "").replace("\\", "/").rpartition("/")[2]
    try:
        if name:
            blank.known(root, folder.name, name)
    except UsageError:
        _tell(f"The sheet is for {name}: copy that robot file into {folder}, and type this again.")
        return None
    return name or None


def _propose_rail(folder: Path, proposal: FilesProposal, files: Mapping[str, bytes]) -> None:
    """Name the command for an arm that files name, where the joint log has a rail."""
    from pipeline.intake.which_logs import called
    from pipeline.machine.robot import SHIPPED, load

    arms = [name for name in called(files, SHIPPED) if not load(name).prismatic.any()]
    railed = [one for one in proposal.robots if one in SHIPPED and load(one).prismatic.any()]
    if arms and railed and not proposal.called:
        _tell(
            f"{arms[0]} ships without the rail that {proposal.joints} has. Type `pipeline robot "
            f"{arms[0]} --rail y --output {typed(str(folder / f'{arms[0]}_rail.toml'))}` (y or the "
            "other direction of F_b in which it moves), and this again."
        )


def _robot_before(root: Path, folder: Path, text: str) -> str | None:
    """The robot that a campaign.toml names, if it is known."""
    from pipeline.base import toml
    from pipeline.intake import blank

    name = toml.loads(text, "campaign.toml").get("robot")
    with contextlib.suppress(UsageError):
        if isinstance(name, str):
            blank.known(root, folder.name, name)
            return name
    return None


def _stated(path: Path | None) -> ExportSettings:
    """What the [tracker] of a campaign.toml says about exports, as far as it is answered.

    While the columns of a table are asked, its mapping is a guess and not a statement.
    """
    from pipeline.base import files, strict, toml
    from pipeline.readers import ExportSettings
    from pipeline.reduction.settings import unfilled

    if path is None:
        return ExportSettings()
    text = files.words(path, path.name, toml.LARGEST_TEXT)
    known = _tracker(text, path.name)
    guessed = {"mapping"} if "columns" in unfilled(text).values() else set()
    keys = (ExportSettings.model_fields.keys() & known) - guessed
    content = {key: known[key] for key in keys}
    return strict.checked(ExportSettings, content, path.name, "[tracker]", "correct it", text)


def _tracker(text: str, name: str) -> dict[str, Any]:
    """The [tracker] of a campaign.toml, empty if there is no such table."""
    from pipeline.base import toml

    tracker = toml.loads(text, name).get("tracker")
    return tracker if isinstance(tracker, dict) else {}


def _settled(files: Mapping[str, bytes], hints: ExportSettings) -> FilesProposal:
    """What the files say, after asking for everything they leave open about exports and names."""
    from pipeline.intake import asking
    from pipeline.intake.files import propose

    tell = partial(typer.echo, err=True)
    proposal = propose(files, hints)
    while proposal.offer and proposal.offer.question:
        hints = hints.model_copy(update=asking.ask(proposal.offer, tell))
        proposal = propose(files, hints)
    if len(proposal.names) > 1:
        question = "How do names hold group and target?"
        named = asking.numbered(question, proposal.names, proposal.names, tell)
        hints = hints.model_copy(update={"names": named})
        proposal = propose(files, hints)
    if proposal.either:
        words = tuple(one.states[0] for one in proposal.either)
        word = _one_of("Word of the unloaded state in group names", words)
        proposal = propose(files, hints, word)
    return proposal


def _tell(words: str) -> None:
    """Show one line on stderr, on a terminal or not."""
    typer.secho(fitted(words, sys.stderr), err=True, dim=sys.stderr.isatty())


def _robot(
    root: Path, folder: Path, proposal: FilesProposal, files: Mapping[str, bytes], ask: bool
) -> str | None:
    """The only robot file in the folder that fits, or the only robot that files name by its type.

    Else the typed one; None if it stays open: that one robot that ships fits proves nothing.
    """
    from pipeline.intake.which_logs import brought

    fitting, own = proposal.robots, brought(files)
    if proposal.joints:
        own = tuple(one for one in own if one in fitting)
    for only, why in ((own, "the only robot file here that fits"), (proposal.called, "named here")):
        if len(only) == 1:
            _tell(f"robot: {only[0]}, {why}; confirm it in campaign.toml")
            return only[0]
    usual = _USUAL if proposal.nothing and not proposal.refused else None
    return _typed_robot(root, folder, fitting, usual) if ask else usual


def _typed_robot(root: Path, folder: Path, fitting: Sequence[str], usual: str | None) -> str | None:
    """The robot typed, asked until it is known; None if it stays open."""
    from pipeline.intake import blank

    for line in blank.described(folder, fitting):
        _tell(line)
    which = "which of these" if fitting else "one of these, or a robot file"
    while typed := _typed(f"Robot, {which}", usual):
        try:
            blank.known(root, folder.name, typed)
        except UsageError as unknown:  # a brand name, as on the type plate: similar ones are named
            _tell(str(unknown).removeprefix("--robot: "))
        else:
            return typed
    return None


def _typed(question: str, usual: str | None) -> str:
    """The typed answer, or the usual one if there is one."""
    return str(typer.prompt(question, usual, err=True)) if usual else _answer(question)


def _asked(proposal: FilesProposal, robot: str | None, given: KnownData) -> KnownData:
    """Ask for data that only a person knows, one at a time; an empty answer leaves it open.

    What a filled-in sheet states is not asked again.
    """
    from pipeline.intake.blank import log_columns
    from pipeline.machine.instrument import sheet
    from pipeline.readers._units import USUAL_UNITS
    from pipeline.readers.logs import LENGTH

    unit = None
    if proposal.reach is not None:
        unit = _one_of(f"Unit of lengths, the numbers reach {proposal.reach:.0f}", USUAL_UNITS)
    columns = _columns(log_columns(proposal, robot))
    tracker = given.words.get("instrument.model") or _instrument()
    sigma_m = None
    if tracker is None or sheet(tracker) is None:
        sigma_m = _size(
            "Standard uncertainty of one tracker reading per axis [mm]", LENGTH, "mm",
            "Enter: it is found from repeats and misfit",
        )  # fmt: skip
    sigma_n, mass_sigma_kg = _of_loads(proposal, given)
    warm = given.temperature_c
    if proposal.exports and warm is None:
        warm = _number("Temperature of base, and rail if any [degC]", "Enter: not known")
    return replace(
        given,
        robot=robot,
        unit=unit,
        instrument=tracker,
        sigma_m=sigma_m,
        sigma_n=sigma_n,
        mass_sigma_kg=mass_sigma_kg,
        temperature_c=warm,
        places={**given.places, **(_places(proposal, given.places) if proposal.measured else {})},
        columns=columns,
    )


def _of_loads(proposal: FilesProposal, given: KnownData) -> tuple[float | None, float | None]:
    """Standard uncertainties of the scale [N] and of weights [kg]; None if unknown."""
    from pipeline.readers.logs import FORCE, MASS

    sigma_n, mass_sigma_kg = given.sigma_n, None
    if "force" in proposal.unsure and sigma_n is None:
        # step / sqrt(12), GUM F.2.2.1
        _tell("Of the scale, its certificate says it; the last digit alone makes 0.29 of a step.")
        sigma_n = _size("Standard uncertainty of one scale reading [N]", FORCE, "n")
    if "mass" in proposal.unsure:
        mass_sigma_kg = _size("Standard uncertainty of one weight [kg]", MASS, "kg")
    return sigma_n, mass_sigma_kg


def _places(
    proposal: FilesProposal, known: Mapping[str, tuple[float, float, float]]
) -> dict[str, tuple[float, float, float]]:
    """Positions of the reflectors that were read [m]; known or open ones are left out."""
    from pipeline.readers.logs import LENGTH
    from pipeline.reduction.settings import HALL_M, REACH_M

    _tell("Places are in metres, or as 120 35 -40 mm or 4.7 1.4 -1.6 in.")
    # in the order in which campaign.toml has them
    frames = [
        ("F_b", proposal.base, HALL_M),
        ("the flange frame", ["load_point", *proposal.measured], REACH_M),
    ]
    found = {
        name: _place(f"{name} in {frame}, x y z [m]", LENGTH, most_m)
        for frame, names, most_m in frames
        for name in names
        if name not in known
    }
    return {name: at for name, at in found.items() if at is not None}


def _instrument() -> str | None:
    """The type of tracker, None if it stays open; one that is in no list is asked once more."""
    from pipeline.machine.instrument import near, sheet

    typed = _answer("Tracker, as Leica AT960", "Enter: any other; its noise is asked instead")
    if not typed or sheet(typed) is not None:
        return typed or None
    like = near(typed)
    _tell(
        f'The data sheet of "{typed}" is not known{f"; like it: {listed(like)}" if like else ""}.'
    )
    again = _answer("Tracker", "Enter: it is written as typed") if like else ""
    return again or typed


def _columns(stated: Mapping[str, str]) -> dict[str, str]:
    """Our names for titles that state no unit; those with the same possible units share it.

    Args:
        stated: All our names by title, separated by bars.
    """
    titles: dict[tuple[str, ...], list[str]] = {}
    for title, ours in stated.items():
        if "|" in ours:
            units = tuple(name.rpartition("_")[2] for name in ours.split("|"))
            titles.setdefault(units, []).append(title)
    out = {}
    for units, alike in titles.items():
        if unit := _one_of(f"Unit of {listed(alike)}", units):
            names = {title: stated[title].split("|")[units.index(unit)] for title in alike}
            out.update(names)
    return out


def _answer(question: str, otherwise: str = _OPEN) -> str:
    """The typed answer, stripped; empty where it stays open."""
    asked = f"{question} ({otherwise})"
    return str(typer.prompt(asked, "", err=True, show_default=False)).strip()


def _one_of(question: str, words: tuple[str, ...]) -> str | None:
    """One of some words, asked until it is valid."""
    while answer := _answer(f"{question}: {', '.join(words)}"):
        if meant := [word for word in words if word.lower() == answer.lower()]:
            return meant[0]
        typer.echo(f'"{answer}" is none of {", ".join(words)}.', err=True)
    return None


def _size(
    question: str, units: Mapping[str, float], usual: str, otherwise: str = _OPEN
) -> float | None:
    """A number above zero in SI, asked until it is valid; decimal commas are accepted."""
    while answer := _answer(question, otherwise):
        with contextlib.suppress(ValueError):
            (size,) = _in_si(answer, units, usual)
            if size > 0:
                return size
        typer.echo(f'"{answer}" is no number above zero.', err=True)
    return None


def _in_si(answer: str, units: Mapping[str, float], usual: str) -> list[float]:
    """Numbers separated by blanks or semicolons, perhaps followed by a unit, in SI.

    Raises:
        ValueError: They are no numbers, or the unit is none of these.
    """
    cells, unit = re.fullmatch(r"(.*?)\s*([^\W\d_]*)", answer, re.DOTALL).groups()  # type: ignore[union-attr]
    if (unit or usual).lower() not in units:
        raise ValueError(unit)
    factor = units[(unit or usual).lower()]
    values = [float(one.replace(",", ".")) for one in re.split(r"[;\s]+|,\s+", cells)]
    if not all(map(math.isfinite, values)):
        raise ValueError(answer)
    return [float(f"{value * factor:.12g}") for value in values]  # 0.6, not 0.6000000000000001


def _number(question: str, otherwise: str) -> float | None:
    """A number, asked until it is valid."""
    while answer := _answer(question, otherwise):
        with contextlib.suppress(ValueError):
            if math.isfinite(number := float(answer.replace(",", "."))):
                return number
        typer.echo(f'"{answer}" is no number.', err=True)
    return None


def _seen(proposal: FilesProposal) -> Iterator[str]:
    """Interpretation of the files, shown before anything is asked."""
    from pipeline.intake import blank

    known = {"exports": proposal.patterns, "loads": [proposal.loads], "joints": [proposal.joints],
             "measured targets": proposal.measured, "chain": proposal.chain,
             "base": proposal.base}  # fmt: skip
    for what, found in known.items():
        if any(found):
            yield f"{what}: {listed(map(str, found), most=40)}"
    if proposal.anchors:
        anchors = dict.fromkeys(one for own in proposal.anchors.values() for one in own)
        yield (
            f"{listed(anchors, most=20)}: anchors, by the column {listed(proposal.anchors)} of "
            f"{proposal.loads}; the chain goes from load_point straight to the anchor of its row"
        )
    if proposal.by_file:
        yield f"groups: named by {proposal.by_file}, of {len(proposal.exports)} files"
    if proposal.measured and not proposal.base:
        yield "base: no reflector is known; without [base_frame] readings are taken to be in F_b"
    yield from (f"{one}." for one in (*proposal.nominal.seen, *blank.not_used(proposal.refused)))


def _place(
    question: str, units: Mapping[str, float], most_m: float
) -> tuple[float, float, float] | None:
    """Three coordinates [m], none beyond `most_m`, asked until they are valid; they are echoed."""
    while answer := _answer(question):
        with contextlib.suppress(ValueError):
            x, y, z = _in_si(answer, units, "m")
            if max(map(abs, (x, y, z))) <= most_m:
                _tell(f"  {question.partition(' ')[0]} = {x:g}, {y:g}, {z:g} m")
                return x, y, z
            typer.echo(
                f"{max(map(abs, (x, y, z))):g} m is out of reach: write {answer} mm, if these are "
                "millimetres.",
                err=True,
            )
            continue
        typer.echo(f'"{answer}" is no three numbers: write 0.2 0.05 0.12, or 200 50 120 mm.',
                   err=True)  # fmt: skip
    return None


def inspect(
    file: Annotated[
        Path, Argument(metavar="FILE", help="A tracker export, a load log or a joint log.")
    ],
    unit: Annotated[
        str | None, Option(help="Unit of length if the file does not state it: mm, m or in.")
    ] = None,
    decimal: Annotated[
        str | None, Option(help="Decimal mark if the file does not show it: . or ,")
    ] = None,
    angles: Annotated[
        str | None, Option(help="Unit of angles if not stated: deg, rad, gon or dms (D.MMSS).")
    ] = None,
    vertical: Annotated[
        str | None, Option(help="Vertical angle if not stated: zenith or elevation.")
    ] = None,
    horizontal: Annotated[
        str | None,
        Option(help="Sense of horizontal angles if not stated: clockwise or counter-clockwise."),
    ] = None,
    coordinates: Annotated[
        str | None, Option(help="Coordinates if not stated: cartesian, spherical or cylindrical.")
    ] = None,
    sheet: Annotated[
        str | None, Option(help="Sheet of a workbook, if several may be meant.")
    ] = None,
    mapping: Annotated[
        Path | None, Option(metavar="TOML", help="Try the [tracker.mapping] in this file.")
    ] = None,
    as_json: AsJson = False,
    csv: Annotated[bool, Option("--csv", help="Print the readings as CSV, in SI units.")] = False,
) -> None:
    """Describe a file: its format, unit, coordinates and times, and what is wrong with it.

    For a table in an unknown format it says what each column seems to be, for a log whether it
    holds loads or joint values, and what to write into campaign.toml. On a terminal it asks for
    whatever the file leaves open.
    """
    from pipeline.intake import asking, describe_file
    from pipeline.readers._units import USUAL_UNITS

    entries = {
        "unit": _known("unit", unit, USUAL_UNITS),
        "decimal": _known("decimal mark", decimal, (".", ",")),
        "angle": _known("unit of angles", angles, ("deg", "rad", "gon", "dms")),
        "vertical": _known("vertical angle", vertical, ("zenith", "elevation")),
        "horizontal": _known("sense of angles", horizontal, ("clockwise", "counter-clockwise")),
        "coordinates": _known("kind", coordinates, ("cartesian", "spherical", "cylindrical")),
        "sheet": sheet,
    }
    answers = sys.stdin.isatty() and sys.stderr.isatty() and not as_json
    ask = partial(asking.ask, say=partial(typer.echo, err=True)) if answers else None
    outcome = describe_file.inspect(file, entries, csv, mapping, ask)
    show(outcome, as_json)
    raise typer.Exit(outcome.exit_code)


def _known(what: str, word: str | None, known: Sequence[str]) -> str | None:
    """Check that a word of the command line is one of a few."""
    if word is None or word in known:
        return word
    others = f"{', '.join(known[:-1])} or {known[-1]}"
    raise UsageError(f'there is no {what} "{word}": use {others}')
