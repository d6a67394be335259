"""Gettext catalogues: complete, compiled, and no translated text stays English."""

import re
import struct
from functools import cache
from pathlib import Path

import pytest
from english import ENGLISH

import pipeline.house
from bench import messages
from bench.messages import SPOKEN
from pipeline.base.language import Language, spoken
from pipeline.house.catalogue import Catalogue

FOLDER = Path(pipeline.house.__file__).parent / "locale"
OTHERS = [Language.DE, Language.FR]
texts = cache(messages.texts)  # all of the source is read for them


def written(path):
    """Texts of a .po file and their translations, from the file format only."""
    found, now = {}, None
    for line in path.read_text("utf-8").splitlines():
        kind, _, rest = line.partition(" ")
        if kind in ("msgid", "msgstr"):
            now = [""] if kind == "msgid" else now
            now = [*now, ""] if kind == "msgstr" else now
            line = rest
        if line.startswith('"'):
            now[-1] += line[1:-1].replace("\\n", "\n").replace('\\"', '"').replace("\\\\", "\\")
            if len(now) == 2:
                found[now[0]] = now[1]
    return found


def compiled(path):
    """The same from a .mo file, according to the manual of gettext."""
    data = path.read_bytes()
    magic, _, count, ids, strings = struct.unpack_from("<5I", data)
    assert magic == 0x950412DE

    def at(table, k):
        length, begin = struct.unpack_from("<2I", data, table + 8 * k)
        return data[begin : begin + length].decode()

    return {at(ids, k): at(strings, k) for k in range(count)}


@pytest.mark.parametrize("language", OTHERS)
def test_every_text_of_the_source_is_said(language):
    """No text lacks a translation, and no translation lacks its text: `make words`."""
    said = written(FOLDER / f"{language}.po")
    header = said.pop("")

    assert said.keys() == texts().keys()
    assert [one for one, there in said.items() if not there.strip()] == []
    assert "charset=utf-8" in header


@pytest.mark.parametrize("language", OTHERS)
def test_what_is_shipped_is_compiled_from_what_is_written(language):
    """The .mo files agree with the .po files: `make words`."""
    binary, text = (compiled(FOLDER / f"{language}.mo"), written(FOLDER / f"{language}.po"))
    binary.pop(""), text.pop("")

    assert binary == text


@pytest.mark.parametrize("language", OTHERS)
def test_a_translation_has_what_varies_in_its_text(language):
    """Each `{}` at least once, by its place, and no other; joining marks on the same side."""
    for english, there in written(FOLDER / f"{language}.po").items():
        places = {int(k) for k in re.findall(r"\{(\d)(?:!r|:small)?\}", there)}
        assert places == set(range(english.count("{}"))), english
        assert not english or english[-1] != " " or there[-1] == " ", english
        assert not english or english[0] != " " or there[0] in " ,", english


def test_every_place_that_speaks_is_there():
    """If a file or function is moved or renamed, its texts would silently be lost."""
    root = Path(pipeline.house.__file__).parents[1]
    lost = [
        (pattern, name)
        for pattern, names in SPOKEN.items()
        for name in names or [""]
        if not any(
            re.search(rf"^(def |class )?{name}\b", path.read_text("utf-8"), re.MULTILINE)
            for path in root.glob(pattern)
        )
    ]
    assert lost == []


def test_the_file_of_an_effect_is_searched_whatever_its_name():
    """All but `nameless.py`, which no certificate names: a file with a line of its own."""
    root = messages.ROOT
    searched = {
        path
        for pattern, names in SPOKEN.items()
        if names is not None
        for path in messages.files_of(pattern)
    }
    effects = root.glob("machine/effects/*.py")
    silent = [
        path.name for path in effects if "noun=" in path.read_text("utf-8") and path not in searched
    ]

    assert silent == ["nameless.py"]
    assert not [one for one in texts().values() if one.endswith("nameless.py")]


@pytest.mark.parametrize(
    ("english", "german", "french"),
    [
        ("3.797 ± 0.009 MN·m/rad", "3,797 ± 0,009 MN·m/rad", "3,797 ± 0,009 MN·m/rad"),
        ("joint_1 -20.00°, S 1.5 m, A4 7.00°", "joint_1 -20,00°; S 1,5 m; A4 7,00°",
         "joint_1 -20,00°; S 1,5 m; A4 7,00°"),
        ("(0.43, 0.86, -0.26)", "(0,43; 0,86; -0,26)", "(0,43; 0,86; -0,26)"),
        ("2026-11-03 08:00 to 10:31", "2026-11-03 08:00 bis 10:31", "2026-11-03 08:00 à 10:31"),
        ("serial number 4.10", "Seriennummer 4.10", "numéro de série 4.10"),
        ("part.csv, pose 12: fail", "part.csv, Stellung 12: überschritten",
         "part.csv, pose 12 : non conforme"),
        ("Roll of the carriage about the rail, 14.56 ± 0.60 nrad/(N·m)",
         "Rollen des Schlittens um die Schiene, 14,56 ± 0,60 nrad/(N·m)",
         "Roulis du chariot autour du rail, 14,56 ± 0,60 nrad/(N·m)"),
        ("tilt of the bearing in joint 5 (A4) or lost motion in joint 6 (A5)",
         "Kippen des Lagers in Gelenk 5 (A4) oder Lose in Gelenk 6 (A5)",
         "basculement du palier dans l'articulation 5 (A4) ou jeu dans l'articulation 6 (A5)"),
        ("For the tolerance: reduce the force or measure more. Use these stiffnesses.",
         "Für die Toleranz: die Kraft verringern oder mehr messen. Diese Steifigkeiten verwenden.",
         "Pour la tolérance : réduire la force ou mesurer davantage. Utiliser ces rigidités."),
        ("poses.csv: the joint values of p1 to p9 (9) stand one pose too late; those of the first "
         "belong to the last (poses.csv:2 ...): as recorded, their targets are up to 5.6 m from "
         "where the robot file places them, and 6.9 mm with the places exchanged",
         "poses.csv: die Gelenkwerte von p1 bis p9 (9) stehen eine Stellung zu spät; die der "
         "ersten gehören zur letzten (poses.csv:2 ...): wie aufgezeichnet liegen ihre Reflektoren "
         "bis zu 5,6 m von dort, wo die Roboterdatei sie hat, und 6,9 mm mit getauschten Plätzen",
         "poses.csv : les valeurs articulaires de p1 à p9 (9) sont en retard d'un rang (pose) ; le "
         "contenu du premier appartient au dernier (poses.csv:2 ...) : tels qu'enregistrés, leurs "
         "réflecteurs sont jusqu'à 5,6 m de là où le fichier du robot les place, et à 6,9 mm "
         "une fois échangées"),
        ("No question is open. Optional: pulls along the rail would improve E1 most. Its standard "
         "uncertainty is 7.9 %.",
         "Keine Frage ist offen. Freiwillig: Züge entlang der Schiene würden E1 am meisten "
         "verbessern. Die Standardunsicherheit beträgt 7,9 %.",
         "Aucune question n'est ouverte. Facultatif : des tractions le long du rail amélioreraient "
         "le plus E1. L'incertitude type est de 7,9 %."),
        ("What would tell which cause it is: reflectors at the elbow.",
         "Was zeigen würde, welche Ursache es ist: Reflektoren am Ellbogen.",
         "Ce qui dirait de quelle cause il s'agit : réflecteurs au coude."),
    ],
)  # fmt: skip
def test_what_varies_is_said_in_turn(english, german, french):
    """Causes within sentences, numbers with a comma, names unchanged."""
    assert spoken(Language.DE)(english) == german
    assert spoken(Language.FR)(english) == french
    assert spoken(Language.EN)(english) is english


def test_english_reads_no_catalogue(monkeypatch):
    """It costs nothing: not even the file is opened."""

    def never(*_):
        raise AssertionError

    monkeypatch.setattr(Catalogue, "_parse", never)
    assert spoken("en")("Use these stiffnesses.") == "Use these stiffnesses."


@pytest.mark.sampled(1)
@pytest.mark.parametrize("language", OTHERS)
def test_every_text_is_found_in_a_sentence(language):
    """With a number in the variable place, whatever else would match."""
    say = spoken(language)
    told = {one.replace("{}", "7"): "" for one in texts()}
    left = {one: say(one) for one in told if ENGLISH.search(re.sub(r"\[.*?\]", "", say(one)))}

    assert left == {}
