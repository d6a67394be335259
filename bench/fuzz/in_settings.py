"""Mutations of campaign.toml: all documented keys, hostile names, globs and patterns, odd TOML."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np

from bench.fuzz.mutation import TOML, Act, Files, Mutation, data_of, one, raw, text, two, with_text

# --- keys ----------------------------------------------------------------------------------------

_KEYS = {
    "": ("format", "name", "robot", "date"),
    "tracker": (
        *("files", "unit", "decimal", "coordinates", "angle", "vertical", "horizontal"),
        *("covariance", "coverage_factor", "names", "groups", "assignment", "sigma_m", "noise"),
    ),
    "tracker.mapping": ("columns", "delimiter", "header", "comment", "time_format"),
    "naming": ("group", "measured", "chain"),
    "base_frame": ("B1", "B2", "B3"),
    "scale": ("file", "sigma_n", "sigma_rel", "gain_sigma", "zero_sigma_n"),
    "joints": ("file", "sigma_m", "sigma_rad"),
    "tool": ("load_point", "P1", "P2", "P3"),
    "tool_uncertainty": ("sigma_m", "load_point_sigma_m"),
    "test_pose": ("q", "force_n"),
    "model": ("equilibrium",),
    "displacements": ("file", "forces", "sigma_m"),
}
"""Keys that are spoilt, by table: most of docs/campaign.md."""

_WEIGHTS = "how certain each reading is decides how they are weighed, and only its user knows"
_MEANT = {
    **{
        (table, key): _WEIGHTS
        for table, keys in _KEYS.items()
        for key in keys
        if "sigma" in key or key in ("noise", "covariance", "coverage_factor")
    },
    ("model", "equilibrium"): "whether the wrench acts on the deflected robot is the user's choice",
}
"""Keys that may rightly change the answer, and why."""

_VALUES = {
    "a word": '"elephant"',
    "empty word": '""',
    "number": "12",
    "zero": "0",
    "negative": "-1.0",
    "tiny": "1e-300",
    "small": "1e-12",
    "huge": "1e160",
    "largest": "1.7976931348623157e308",
    "nan": "nan",
    "inf": "inf",
    "true": "true",
    "list": "[]",
    "list of words": '["a", "b"]',
    "list of one": '["P1"]',
    "two numbers": "[1.0, 2.0]",
    "three numbers": "[0.1, 0.2, 0.3]",
    "three nan": "[nan, nan, nan]",
    "three huge": "[1e160, 1e160, 1e160]",
    "nested lists": "[[1], [2, [3]]]",
    "table": "{ a = 1 }",
    "date": "2026-11-03",
    "moment": "2026-11-03T08:00:00+23:59",
    "huge integer": "9" * 400,
    "long word": '"' + "A" * 10_000 + '"',
    "control": r'"a\u0007\u001b[31mb"',
    "line end": r'"a\nb"',
    "nul": r'"a\u0000b"',
    "emoji": raw('"🤖"'),
    "right to left": raw('"\u202eabc\u2066"'),
    "html": "\"<script>alert('1')</script>\"",
    "path out": '"../../../../etc/passwd"',
    "absolute path": '"/etc/hostname"',
    "folder": '"."',
    "itself": '"campaign.toml"',
    "formula": "\"=cmd|' /C calc'!A0\"",
    "braces": '"{0} %s {x!r} $HOME `id`"',
    "quotes": '\'"""\'',
}


def _here(line: str) -> str | None:
    """The table that begins at a line; None if none does."""
    found = re.match(r"\s*\[([^\[\]]+)\]\s*$", line)
    return found[1].strip() if found else None


def _place(lines: list[str], table: str, key: str) -> tuple[int | None, int | None]:
    """Indices of the line of a key and of the line behind the heading of its table."""
    at, head = "", 0 if not table else None
    for k, line in enumerate(lines):
        begun = _here(line)
        if begun is not None:
            at = begun
            head = k + 1 if at == table else head
        elif at == table and re.match(rf"\s*{re.escape(key)}\s*=", line):
            return k, head
    return None, head


def with_key(content: str, table: str, key: str, value: str | None) -> str:
    """TOML text with a key set, or removed."""
    lines = content.split("\n")
    found, head = _place(lines, table, key)
    line = [] if value is None else [f"{key} = {value}"]
    if found is not None:
        return "\n".join([*lines[:found], *line, *lines[found + 1 :]])
    if head is not None:
        return "\n".join([*lines[:head], *line, *lines[head:]])
    return "\n".join([*lines, f"[{table}]", *line, ""]) if line else content


def key(table: str, name: str, value: str | None) -> Act:
    """A mutation that sets or removes one key."""
    return lambda files, rng: with_text(files, TOML, lambda t: with_key(t, table, name, value))


def _drawn(table: str, name: str) -> Act:
    def act(files: Files, rng: np.random.Generator) -> Files:
        return key(table, name, one(rng, list(_VALUES.values())))(files, rng)

    return act


def _scaled(table: str, name: str) -> Act:
    """Multiply the numbers of an entry by a factor."""

    def act(files: Files, rng: np.random.Generator) -> Files:
        factor = one(rng, [1e3, 1e-3, 25.4, -1.0, 1e6, 1e-6, 1.5])

        def edit(content: str) -> str:
            lines = content.split("\n")
            found, _ = _place(lines, table, name)
            if found is None:
                return content
            numbers = r"-?[0-9]+\.?[0-9]*(?:e[+-]?[0-9]+)?"
            head, mark, value = lines[found].partition("=")
            value = re.sub(numbers, lambda m: f"{float(m[0]) * factor:.9g}", value, count=3)
            return "\n".join([*lines[:found], head + mark + value, *lines[found + 1 :]])

        return with_text(files, TOML, edit)

    return act


def _twice(table: str, name: str) -> Act:
    def edit(content: str) -> str:
        lines = content.split("\n")
        found, _ = _place(lines, table, name)
        return (
            content if found is None else "\n".join([*lines[:found], lines[found], *lines[found:]])
        )

    return lambda files, rng: with_text(files, TOML, edit)


_WRITTEN = {
    *(("", name) for name in ("format", "name", "robot")),
    *(("tracker", name) for name in ("files", "sigma_m", "noise", "unit")),
    *(("base_frame", name) for name in _KEYS["base_frame"]),
    *(("scale", name) for name in _KEYS["scale"]),
    *(("tool", name) for name in _KEYS["tool"]),
    *(("test_pose", name) for name in _KEYS["test_pose"]),
    *(("naming", name) for name in ("measured", "chain")),
    ("joints", "file"),
    ("displacements", "sigma_m"),
}
"""Keys present in a clean campaign, to be scaled or doubled."""


def _each_key() -> list[Mutation]:
    acts: dict[str, Callable[[str, str], Act]] = {
        "missing": lambda table, name: key(table, name, None),
        "another value": _drawn,
        "scaled": _scaled,
        "twice": _twice,
    }
    return [
        Mutation(f"key:{table}.{name} {how}", act(table, name), _MEANT.get((table, name), ""))
        for table, names in _KEYS.items()
        for name in names
        for how, act in acts.items()
        if how in ("another value", "missing") or (table, name) in _WRITTEN
    ]


# --- values that are allowed, but wrong here ---------------------------------------------------

_WORDS = {
    ("", "robot"): ["kr500_rail", "kr500_rail_kuka", "fanuc_r2000ic", "KR500_RAIL", "nobody"],
    ("", "format"): ["2", "1.0", '"1"', "true"],
    ("", "date"): ['"2026-11-03"', "2026-11-03", "0001-01-01", "9999-12-31", "2026-02-30"],
    ("tracker", "unit"): ['"mm"', '"m"', '"in"', '"MM"', '"km"'],
    ("tracker", "decimal"): ['"."', '","', '";"'],
    ("tracker", "coordinates"): ['"cartesian"', '"spherical"', '"cylindrical"'],
    ("tracker", "angle"): ['"deg"', '"rad"', '"gon"', '"dms"'],
    ("tracker", "vertical"): ['"zenith"', '"elevation"'],
    ("tracker", "horizontal"): ['"clockwise"', '"counter-clockwise"'],
    ("tracker", "covariance"): ['"a-priori"', '"standard"', '"expanded"', '"rms"', '"none"'],
    ("tracker", "coverage_factor"): ["1", "2", "3.0", "1e-9", "1e9"],
    ("tracker", "noise"): [
        '"paper"',
        "{ range_m = 0, range_per_m = 0, transverse_m = 0, transverse_per_m = 0 }",
        "{ range_m = 1e-300, range_per_m = 1, transverse_m = 1e160, transverse_per_m = 0 }",
        "{ range_m = 1e-5 }",
    ],
    ("naming", "measured"): [
        *('["P1"]', '["P1", "P2"]', '["P1", "P2", "P2", "P3"]', '["P3", "P1", "P2"]', "[]"),
        *(
            '["Pl1", "Pl2"]',
            '["P1", "P2", "P3", "P4"]',
            '["B1", "B2", "B3"]',
            '["P1", "load_point"]',
        ),
    ],
    ("naming", "chain"): [
        *('["Pl2", "Pl1"]', '["Pl1", "Pl1"]', '["P1", "P2"]', '["Pl1"]', '["B1", "B2"]'),
        *('["Pl1", "P1"]', '["Pl1", "Pl2", "Pl1"]', '["", ""]'),
    ],
    ("model", "equilibrium"): ['"undeformed"', '"deformed"', '"Deformed"'],
    ("test_pose", "q"): ["[8.5, -10, 35, 39, 81, 22, -10]", "[1e3, 0, 0, 0, 0, 0, 0]", "[0, 0]"],
    ("test_pose", "force_n"): ["[0, 0, 0]", "[1e-300, 0, 0]", "[1e160, 0, 0]", "[nan, 1, 1]"],
    ("scale", "file"): ['"joints.csv"', '"tracker.csv"', '"loads.CSV"', '"nope.csv"'],
    ("joints", "file"): ['"loads.csv"', '"tracker.csv"', '"./joints.csv"', '"nope.csv"'],
    ("tracker", "assignment"): ['"loads.csv"', '"tracker.csv"', '"nope.csv"', '"assignment.csv"'],
    ("tracker.mapping", "columns"): [
        "{ group = 1, target = 2, x = 3, y = 4, z = 5, time = 6 }",
        '{ group = "group", target = "target", x = "x_mm", y = "y_mm", z = "z_mm" }',
        "{ group = 0, target = -1, x = 3, y = 3, z = 3 }",
        "{ group = 1, target = 2, range = 3, azimuth = 4, vertical = 5 }",
        "{ x = 99999999999, y = 1, z = 2 }",
    ],
    ("tracker.mapping", "delimiter"): ['","', '""', '" "', '"::"', r'"\n"', '"x"'],
    ("tracker.mapping", "header"): ["0", "1", "-1", "99999999999", "1.5"],
    ("tracker.mapping", "comment"): ['"#"', '""', '","', '"p"'],
    ("tracker.mapping", "time_format"): ['"%Y"', '"%"', '"%Q%%%"', '""'],
}

_GLOBS = [
    *("", "*", "***", "a**b", "**", "**/*", "*.csv", "tracker*", "[", "[!]", "[]a]", "{a,b}", "?"),
    *(
        "tracker.csv/",
        "./tracker.csv",
        "/etc/*",
        "../*",
        "~/*",
        "//",
        "a/../tracker.csv",
        ".",
        "..",
    ),
    *("tracker.csv*", "*" * 500, "**/" * 40 + "*.csv", "A" * 5000, "*.toml", "joints.csv", "CON"),
]
_GLOBS += [r"a\u0000b", r"\u001b[31m", r"a\nb", "%2e%2e/x", "*.{csv", "[a-", "[z-a]*", r"*\\*"]

_PATTERNS = [
    *("", "(", ")", "[", "*", "(?P<pose>", "(?P<pose>[0-9]+)", "a{99999999999}", "(" * 3000),
    "pose(?P<pose>[0-9]+)",
    "(?P<pose>.*)(?P<repeat>.*)(?P<state>.*)",
    "(?P<pose>(([0-9a-z_]+)+)+)_(?P<repeat>[0-9]+)X(?P<state>u|l)",
    "pose(?P<pose>([0-9]+)*)*_rep(?P<repeat>[0-9]+)_(?P<state>unloaded|loaded)",
    "pose(?P<pose>[0-9]+)_rep(?P<repeat>[0-9]+)_(?P<state>unloaded|loaded)?",
    "pose(?P<repeat>[0-9]+)_rep(?P<pose>[0-9]+)_(?P<state>unloaded|loaded)",
    "pose(?P<pose>[0-9])[0-9]*_rep(?P<repeat>[0-9]+)_(?P<state>unloaded|loaded)",
    "pose(?P<pose>[0-9]+)_rep(?P<repeat>[0-9]+)_(?P<state>un|loaded|unloaded)",
    "pose(?P<pose>[0-9]+)_rep(?P<repeat>[0-9]+)_un(?P<state>loaded)",
    "(?i)POSE(?P<pose>[0-9]+)_REP(?P<repeat>[0-9]+)_(?P<state>unloaded|loaded)",
    "(?P<pose>[a-z]+)[0-9]+_rep(?P<repeat>[0-9]+)_(?P<state>unloaded|loaded)",
    "(?P<pose>a)|(?P<repeat>b)|(?P<state>c)",
    "(?P<group>.+)(?P<target>.)",
    "(?P<group>(.+)+)::(?P<target>(.+)+)!",
    r"\\",
    "(?<=x*)a",
    raw("(?P<pose>\\\\d+)🤖"),
]


def _quoted(word: str) -> str:
    return f'"{word}"'


def _word(table: str, name: str, values: list[str]) -> Act:
    return lambda files, rng: key(table, name, one(rng, values))(files, rng)


def _allowed() -> list[Mutation]:
    return [
        Mutation(f"word:{table}.{name}", _word(table, name, values), _MEANT.get((table, name), ""))
        for (table, name), values in _WORDS.items()
    ]


# --- names ---------------------------------------------------------------------------------------

_NAMES = {
    "control": r"a\u0007\u001b[31m\u0085b",
    "line ends": r"one\ntwo\r\nthree\u2028four",
    "nul": r"a\u0000b",
    "emoji": raw("🤖👩\u200d🔧"),
    "right to left": raw("\u202egnp.exe\u2066"),
    "10 000 letters": "n" * 10_000,
    "quotes": r"\"'`\"\"\"",
    "html": "<img src=x onerror=alert(1)>&amp;</script>",
    "path": "../../../tmp/x",
    "formula": "=1+1",
    "template": "{{ 7*7 }}{% raw %} #let x = 1 $ @ <label>",
    "empty": "",
    "blank": " ",
    "combining": "z" + raw("\u0335\u0321") * 300,
    "noncharacter": raw("\ufffe\uffff"),
    "reserved": "load_point",
    "xml": "]]><!--\\u000c",
}


def _renamed(old: str, new: str) -> Act:
    """Rename a reflector in every file; keys of TOML are quoted."""

    def act(files: Files, rng: np.random.Generator) -> Files:
        plain = new.encode("latin-1").decode("unicode_escape") if "\\" in new else new
        plain = raw(plain) if any(ord(c) > 255 for c in plain) else plain
        done = {}
        for name, data in files.items():
            content = text(data)
            if name == TOML:
                content = re.sub(rf"(?m)^{old} =", lambda _: f'"{new}" =', content)
                content = content.replace(f'"{old}"', f'"{new}"')
            elif not name.endswith(".toml"):
                content = re.sub(rf"\b{old}\b", lambda _: plain, content)
            done[name] = data_of(content)
        return done

    return act


def _file_renamed(new: str) -> Act:
    def act(files: Files, rng: np.random.Generator) -> Files:
        names = sorted(name for name in files if name != TOML)
        old = one(rng, names)
        moved = {new if name == old else name: data for name, data in files.items()}
        return with_text(moved, TOML, lambda t: t.replace(f'"{old}"', f'"{new}"'))

    return act


_FILE_NAMES = [
    "a b.csv",
    "[x].csv",
    "é.csv",
    "a*.csv",
    "-rf",
    "x.toml",
    "=1+1.csv",
    "#a",
    "n" * 200,
]

# --- TOML ----------------------------------------------------------------------------------------


def _appended(more: str) -> Act:
    return lambda files, rng: with_text(files, TOML, lambda t: f"{t}\n{more}\n")


def _prepended(more: str) -> Act:
    return lambda files, rng: with_text(files, TOML, lambda t: f"{more}\n{t}")


_ODD = {
    "lists 900 deep": _prepended("deep = " + "[" * 900 + "]" * 900),
    "lists 100 000 deep": _prepended("deep = " + "[" * 100_000),
    "tables 900 deep": _prepended("deep = " + "{a=" * 900 + "1" + "}" * 900),
    "integer of 4 400 digits": _prepended("big = " + "1" * 4400),
    "integer of 4 400 digits in a known key": key("scale", "sigma_n", "1" * 4400),
    "integer of 400 digits as sigma": key("tracker", "sigma_m", "1" * 400),
    "dotted key of 3 000 parts": _prepended(".".join(["a"] * 3000) + " = 1"),
    "dotted key of 100 000 parts": _prepended(".".join(["a"] * 100_000) + " = 1"),
    "dotted table": _appended("[" + ".".join(["b"] * 3000) + "]"),
    "dotted known key": _prepended("scale.sigma_n = 3"),
    "table twice": _appended("[tool]\nP1 = [0, 0, 0]"),
    "unknown table": _appended("[hidden]\neffects = []"),
    "unknown key": key("scale", "sigma", "1"),
    "nearly a key": key("tracker", "sigma", "1"),
    "list of tables": _appended("[[scale]]\nsigma_n = 1"),
    "tool as text": _prepended('tool = "P1"'),
    "100 000 keys": _appended("[more]\n" + "\n".join(f"k{i} = {i}" for i in range(100_000))),
    "text of a megabyte": _prepended('remark = """' + "x" * 1_000_000 + '"""'),
    "surrogate": _prepended(r'remark = "\ud800"'),
    "a bare word": _prepended("campaign"),
    "no end of a text": _appended('remark = "'),
    "heading quoted": _appended('["to\\u0007ol"]\n"\\u0000" = 1'),
}


def _from_table_to_table(files: Files, rng: np.random.Generator) -> Files:
    """Move a key under the heading of another table."""

    def edit(content: str) -> str:
        lines = content.split("\n")
        keys = [k for k, line in enumerate(lines) if "=" in line]
        heads = [k for k, line in enumerate(lines) if _here(line) is not None]
        if not keys or not heads:
            return content
        k, head = one(rng, keys), one(rng, heads)
        line = lines[k]
        kept = [None if i == k else each for i, each in enumerate(lines)]
        kept[head] = f"{lines[head]}\n{line}"
        return "\n".join(each for each in kept if each is not None)

    return with_text(files, TOML, edit)


def _values_exchanged(files: Files, rng: np.random.Generator) -> Files:
    """Exchange the values of two keys."""

    def edit(content: str) -> str:
        lines = content.split("\n")
        keys = [k for k, line in enumerate(lines) if "=" in line]
        if len(keys) < 2:
            return content
        a, b = (keys[k] for k in two(rng, len(keys)))
        (ka, _, va), (kb, _, vb) = lines[a].partition("="), lines[b].partition("=")
        lines[a], lines[b] = f"{ka}={vb}", f"{kb}={va}"
        return "\n".join(lines)

    return with_text(files, TOML, edit)


def _table_lost(files: Files, rng: np.random.Generator) -> Files:
    def edit(content: str) -> str:
        tables = content.split("\n\n")
        k = int(rng.integers(len(tables)))
        return "\n\n".join([*tables[:k], *tables[k + 1 :]])

    return with_text(files, TOML, edit)


MUTATIONS = (
    *_each_key(),
    *_allowed(),
    *(
        Mutation(f"glob:{glob[:20]}", key("tracker", "files", f'["{glob}"]'))
        for glob in dict.fromkeys(_GLOBS)
    ),
    *(
        Mutation(f"pattern:{k} {pattern[:30]}", key("naming", "group", _quoted(pattern)))
        for k, pattern in enumerate(_PATTERNS)
    ),
    *(
        Mutation(f"pattern:names {k}", key("tracker", "names", _quoted(pattern)))
        for k, pattern in enumerate(_PATTERNS)
    ),
    *(Mutation(f"name:campaign {how}", key("", "name", f'"{n}"')) for how, n in _NAMES.items()),
    *(
        Mutation(f"name:{target} {how}", _renamed(target, name))
        for target in ("P1", "B2", "Pl1")
        for how, name in _NAMES.items()
    ),
    *(Mutation(f"name:file {name[:20]}", _file_renamed(raw(name))) for name in _FILE_NAMES),
    *(Mutation(f"toml:{name}", act) for name, act in _ODD.items()),
    Mutation("toml:key in another table", _from_table_to_table),
    Mutation("toml:two values exchanged", _values_exchanged),
    Mutation("toml:table lost", _table_lost),
)
