"""Invented robot programs: thirty for each maker, with everything that programs contain.

A program consists of words that must not change and of coordinates, so that a test knows every byte
of it without parsing the language.
"""

import re
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from pipeline.machine.robot import load
from pipeline.machine.robot.mdh import parse

NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"


@dataclass
class Point:
    """A taught point: joint values near it, meaning of its numbers, and their places."""

    kind: str
    q: np.ndarray
    external: float
    tool: str
    base: str
    numbers: list = field(default_factory=list)
    file: str = ""


@dataclass(frozen=True)
class Coordinate:
    """One number of a point in the text."""

    point: int
    text: str


@dataclass
class Made:
    """A program with its truth."""

    files: dict
    encoding: str
    points: list
    tools: dict
    bases: dict
    options: dict

    def data(self, name):
        """The bytes of a file."""
        words = (w if isinstance(w, str) else w.text for w in self.files[name])
        return "".join(words).encode(self.encoding)

    def numbers(self, name, data):
        """The coordinates in other bytes of the same program, as text by point, in order.

        None where anything else than a coordinate is different.
        """
        words = self.files[name]
        pattern = "".join(re.escape(w) if isinstance(w, str) else NUMBER for w in words)
        found = re.fullmatch(pattern, data.decode(self.encoding), re.DOTALL)
        if found is None:
            return None
        out = {}
        coordinates = [w for w in words if not isinstance(w, str)]
        for word, text in zip(coordinates, found.groups(), strict=True):
            out.setdefault(word.point, []).append(text)
        return out


def on_a_rail(name, external="E1"):
    """A robot that ships, on a rail along y, with the controller's external axis."""
    import tomllib

    from pipeline.base import toml

    text = load(name).text
    content = tomllib.loads(text)
    first, *others = content["joint"]
    rail = {"name": "rail", "type": "prismatic", "alpha_deg": -90, "a_m": 0, "d_m": 0}
    rail |= {"lower_m": -1.0, "upper_m": 10.0, "stiffness_n_per_m": 6e7}
    first = {**first, "alpha_deg": first.get("alpha_deg", 0) + 90}
    content["joint"] = [rail, first, *others]
    of = content["controller"]
    of["axes"] = [external, *of["axes"]]
    of["matrix"] = [[1] + [0] * len(of["matrix"])] + [[0, *row] for row in of["matrix"]]
    content["name"] = f"{name}_rail"
    return parse(toml.dumps(content), f"{name}_rail.toml")


def turned(letters, values):
    """Rotation represented by the numbers."""
    if letters == "quaternion":
        return pin.Quaternion(*(np.array(values) / np.linalg.norm(values))).matrix()
    if letters == "vector":
        return pin.exp3(np.array(values, float))
    a, b, c = np.deg2rad(values if letters == "abc" else values[::-1])
    return pin.utils.rotate("z", a) @ pin.utils.rotate("y", b) @ pin.utils.rotate("x", c)


def letters_of(rotation, letters):
    """Numbers that represent a rotation."""
    if letters == "quaternion":
        x, y, z, w = pin.Quaternion(rotation).coeffs()
        return [w, x, y, z]
    if letters == "vector":
        return pin.log3(rotation).tolist()
    wpr = np.rad2deg(pin.rpy.matrixToRpy(rotation)).tolist()
    return wpr if letters == "wpr" else wpr[::-1]


def frame(letters, values):
    """Frame represented by the numbers of a pose [m]."""
    scale = 1.0 if letters == "vector" else 1e-3
    return pin.SE3(turned(letters, values[3:]), scale * np.array(values[:3], float))


class Maker:
    """Common parts of the programs of all makers."""

    letters, joints, axes, suffix = "abc", "deg", (), ""

    def __init__(self, seed, robot, bending):
        self.rng = np.random.default_rng([seed, len(self.suffix), len(robot.joints)])
        self.robot, self.bending = robot, bending
        self.rail = bool(robot.prismatic.any())
        self.points, self.end = [], str(self.rng.choice(["\n", "\r\n"]))
        self.encoding = str(self.rng.choice(["cp1252", "utf-8"]))
        self.tools = {name: self.somewhere(0.2, 0.4) for name in self.tool_names}
        self.bases = {name: self.somewhere(0.6, 0.3) for name in self.base_names}
        self.centre = np.array(self.axes) + self.rng.uniform(-0.1, 0.1, 6)
        self.last = self.centre.copy()

    def somewhere(self, far, turn):
        """The numbers of a frame."""
        place = self.rng.uniform(-far, far, 3) * (1.0 if self.letters == "vector" else 1e3)
        rotation = pin.exp3(self.rng.uniform(-turn, turn, 3))
        digits = 5 if self.letters in ("vector", "quaternion") else 3
        return [round(float(v), digits) for v in (*place, *letters_of(rotation, self.letters))]

    def chance(self, part):
        """Whether a random event occurs."""
        return bool(self.rng.random() < part)

    def word(self, *words):
        """One of some words."""
        return str(self.rng.choice(words))

    def case(self, word):
        """The word in upper or lower case, as typed."""
        return self.word(word, word.lower(), word.capitalize()) if self.chance(0.4) else word

    def gap(self, least=0):
        """Blanks."""
        return " " * int(self.rng.integers(least, least + 3))

    def umlauts(self):
        """Words of a comment, with everything that resembles code."""
        return self.word("Fräsen über Öl", "Hülse größer 5°", "LIN {X 1,Y 2} (Prüfung)", "p[0,0,0]")

    def next(self, kind, tool="", base=""):
        """The next point, near the previous one."""
        step = self.rng.uniform(-0.12, 0.12, 6)
        self.last = np.clip(self.last + step, self.centre - 0.3, self.centre + 0.3)
        external = float(np.round(self.rng.uniform(500, 4000), 1)) if self.rail else 0.0
        axes = np.concatenate([[1e-3 * external] if self.rail else [], self.last])
        q = self.robot.controller_matrix @ axes + self.robot.controller_offset
        point = Point(kind, q, external, tool, base)
        self.points.append(point)
        if kind == "joint":
            values = np.rad2deg(self.last) if self.joints == "deg" else self.last
        else:
            flange = self.bending.flange(q)
            tool_, base_ = (
                frame(self.letters, self.tools[tool]),
                frame(self.letters, self.bases[base]),
            )
            at = base_.inverse() * flange * tool_
            place = at.translation * (1.0 if self.letters == "vector" else 1e3)
            values = [*place, *letters_of(at.rotation, self.letters)]
        return len(self.points) - 1, [float(v) for v in values]

    def digits(self, k, kind):
        """Number of decimals of a number."""
        fine = kind == "joint" or k >= 3
        return int(self.rng.integers(4 if fine else 2, 7))

    def coordinate(self, point, k, value):
        """A number as this program writes it."""
        kind = self.points[point].kind
        text = f"{value:.{self.digits(k, kind)}f}"
        if self.chance(0.1) and self.exponents:
            text = f"{value:.8{self.word('e', 'E')}}"
        elif self.chance(0.1) and self.plus and not text.startswith("-"):
            text = f"+{text}"
        elif self.bare and text.lstrip("-").startswith("0."):
            text = text.replace("0.", ".", 1)
        self.points[point].numbers.append(float(text))
        return Coordinate(point, text)

    exponents = plus = True
    bare = False
    tool_names, base_names = ("1", "2"), ("0", "3")

    def made(self, files, **options):
        """The program with its truth."""
        for name, words in files.items():
            for word in words:
                if isinstance(word, Coordinate):
                    self.points[word.point].file = name
        return Made(files, self.encoding, self.points, self.tools, self.bases, options)

    def given(self, frames, names):
        """Frames as options."""
        return [f"{name}=" + ",".join(map(repr, frames[name])) for name in names]


class Kuka(Maker):
    """KRL: points in the .dat and in the .src."""

    letters, suffix = "abc", ".src"
    axes = np.deg2rad([10, -70, 100, 20, 40, -30])
    tool_names, base_names = ("1", "2"), ("0", "3")
    exponents = False

    def __init__(self, seed, robot, bending):
        super().__init__(seed, robot, bending)
        self.bases["0"] = [0.0] * 6

    def aggregate(self, kind, tool="", base=""):
        """A point between braces."""
        point, values = self.next(kind, tool, base)
        names = ["A1", "A2", "A3", "A4", "A5", "A6"] if kind == "joint" else list("XYZABC")
        out = ["{" + self.gap()]
        if self.chance(0.1):
            out = ["{E6AXIS: " if kind == "joint" else "{E6POS: "]
        for k, (name, value) in enumerate(zip(names, values, strict=True)):
            comma = "" if k == 0 else self.gap() + "," + self.gap()
            out += [f"{comma}{self.case(name)}{self.gap(1)}", self.coordinate(point, k, value)]
        if kind != "joint":
            bits = sum(int(axis < 0) << k for k, axis in enumerate(self.last))
            out += [self.word(f",S 2,T {bits}", f", S 'B010' , T 'B{bits:06b}'")]
        if self.rail:
            out += [f",E1 {self.points[point].external},E2 0.0,E3 0.0"]
        return [*out, self.gap() + "}"]

    def make(self):
        """The program."""
        end, src, dat = self.end, [], []
        src += [f"&ACCESS RVP{end}&REL 4{end}DEF  probe( ){end};FOLD INI {self.umlauts()}{end}"]
        src += [f"{self.gap()}BAS (#INITMOV,0 ){end}  $VEL.CP=0.2{end};ENDFOLD{end}"]
        dat += [f"&ACCESS RVP{end}DEFDAT  probe{end}EXT  BAS (BAS_COMMAND  :IN,REAL  :IN ){end}"]
        src += [f"{self.case('PTP')} ", *self.aggregate("joint"), end]
        for number in range(int(self.rng.integers(3, 6))):
            tool, base = self.word(*self.tool_names), self.word(*self.base_names)
            name = f"XP{number + 1}"
            style = self.word("form", "assigned", "bas")
            if style == "form":
                dat += [f"DECL FDAT FP{number}={{TOOL_NO {tool},BASE_NO {base},IPO_FRAME #BASE,"]
                dat += [f'POINT2[] " ",TQ_STATE FALSE}}{end}']
                src += [f";FOLD LIN {name} Vel=2 m/s CPDAT1 Tool[{tool}] Base[{base}];%{{PE}}{end}"]
                src += [f"$BWDSTART=FALSE{end}LDAT_ACT=LCPDAT1{end}FDAT_ACT=FP{number}{end}"]
            elif style == "bas":
                src += [f"BAS(#TOOL, {tool}){end}BAS (#BASE,{base}){end}"]
            else:
                known = base == "0" and self.chance(0.5)
                where = "$NULLFRAME" if known else f"BASE_DATA[{base}]"
                src += [f"$TOOL = TOOL_DATA[{tool}]{end}"]
                src += [f"{self.case('$BASE')}={where} ; {self.umlauts()}{end}"]
            src += self.motions(name, tool, base, dat)
        src += [
            f"LIN_REL {{Z 100.0}}{end}LIN XP1:{{X 1,Y 2,Z 3,A 0,B 0,C 0}}{end}PTP $POS_ACT{end}"
        ]
        src += [f"END{end}"]
        spare = self.word("ENDDAT", "DECL E6POS XSPARE={X 1.0,Y 2.0,Z 3.0,A 0,B 0,C 0}\r\nENDDAT")
        dat += [f"{spare}{end}"]
        tool = self.given(self.tools, self.tool_names)
        base = self.given(self.bases, self.base_names)
        return self.made({"probe.src": src, "probe.dat": dat}, tool=tool, base=base)

    def motions(self, name, tool, base, dat):
        """Motions to a declared point and to one in braces, some of them in a loop."""
        end, out = self.end, []
        word = self.word("DECL E6POS", "E6POS", "DECL GLOBAL POS", "DECL E6POS", "decl e6pos")
        dat += [f"{word} {name}{self.gap()}={self.gap()}", *self.aggregate("pose", tool, base), end]
        out += [
            f"FOR I=1 TO 3{end}  {self.case('LIN')} {name}{self.word('', ' C_DIS')}{end}ENDFOR{end}"
        ]
        if self.chance(0.5):
            out += [
                f"{self.word('LIN', 'PTP', 'SLIN', 'SPTP')} ",
                *self.aggregate("pose", tool, base),
            ]
            out += [f"{self.gap(1)}C_DIS;{self.umlauts()}{end}"]
        if self.chance(0.3):
            out += ["CIRC ", *self.aggregate("pose", tool, base), " , "]
            out += [*self.aggregate("pose", tool, base), f",CA 90{end}"]
        if self.chance(0.3):
            out += ["PTP ", *self.aggregate("joint", tool), f"{end}"]
        return out


class Abb(Maker):
    """RAPID: declared points, arrays, and points inside the motions."""

    letters, suffix = "quaternion", ".mod"
    axes = np.deg2rad([10, 20, 10, 30, 40, -20])
    tool_names, base_names = ("tool0", "tFräser"[:3] + "Spindle"), ("wobj0", "wTisch")

    def __init__(self, seed, robot, bending):
        super().__init__(seed, robot, bending)
        self.tools["tool0"] = self.bases["wobj0"] = [0.0, 0, 0, 1, 0, 0, 0]

    def list_(self, point, values, first=0):
        """Coordinates in brackets."""
        out = ["[" + self.gap()]
        for k, value in enumerate(values):
            out += ["," + self.gap() if k else "", self.coordinate(point, first + k, value)]
        return [*out, self.gap() + "]"]

    def externals(self, point):
        """The external axes."""
        first = self.points[point].external if self.rail else self.word("9E9", "9E+09")
        return f"{self.word('', ' ')}[{first},9E9,9E+09,9E9,9E9,9E9]"

    def robtarget(self, tool, base):
        """A robtarget, sometimes over several lines."""
        point, values = self.next("pose", tool, base)
        quarters = np.floor(self.last / (np.pi / 2)).astype(int)
        cfx = 2 * int(self.rng.integers(0, 3)) + int(self.last[4] < 0)
        between = self.word(",", ", ", f",{self.end}    ")
        out = ["[", *self.list_(point, values[:3]), between, *self.list_(point, values[3:], 3)]
        out += [f",[{quarters[0]},{quarters[3]},{quarters[5]},{cfx}],{self.externals(point)}]"]
        return out

    def make(self):
        """The module."""
        end, head, body = self.end, [], []
        head += [
            f"%%%{end}  VERSION:1{end}%%%{end}MODULE Probe{end}! {self.umlauts()} [[1,2,3]]; {end}"
        ]
        for name in self.tool_names[1:]:
            t = self.tools[name]
            head += [f"PERS tooldata {name}:=[TRUE,[[{t[0]},{t[1]},{t[2]}],"]
            head += [f"[{t[3]},{t[4]},{t[5]},{t[6]}]],[5,[0,0,100],[1,0,0,0],0,0,0]];{end}"]
        b = self.bases["wTisch"]
        head += [f'TASK PERS wobjdata wTisch := [FALSE,TRUE,"",[[0,0,0],[1,0,0,0]],{end}  ']
        head += [f"[[{b[0]},{b[1]},{b[2]}],[{b[3]},{b[4]},{b[5]},{b[6]}]]];{end}"]
        point, values = self.next("joint", "tool0")
        head += [f"{self.word('LOCAL ', '')}CONST jointtarget jStart{self.gap()}:={self.gap()}["]
        head += [*self.list_(point, values), f",{self.externals(point)}];{end}"]
        checked = self.word("Off", "On")
        body += [f"PROC main(){end}  ConfL\\{checked};{end}"]
        body += [f"  MoveAbsJ jStart\\NoEOffs, v1000, fine, tool0;{end}"]
        for number in range(int(self.rng.integers(3, 6))):
            tool, base = self.word(*self.tool_names), self.word(*self.base_names)
            body += self.motions(f"p{10 * (number + 1)}", tool, base, head)
        body += [f"  MoveL Offs(p10,0,0,50),v100,z10,tool0;{end}"]
        body += [f'  TPWrite "MoveL [[1,2,3],[1,0,0,0]]; größer";{end}ENDPROC{end}ENDMODULE{end}']
        return self.made({"probe.mod": [*head, *body]})

    def motions(self, name, tool, base, head):
        """Motions to a declared point, an inline one and an array."""
        end, out = self.end, []
        wobj = "" if base == "wobj0" else f"{self.gap()}\\WObj:={base}"
        word = self.word(
            "CONST robtarget", "PERS robtarget", "VAR robtarget", "LOCAL CONST robtarget"
        )
        head += [f"{word} {name}{self.gap()}:={self.gap()}", *self.robtarget(tool, base), f";{end}"]
        move = self.case(self.word("MoveL", "MoveJ"))
        out += [f"  FOR i FROM 1 TO 3 DO{end}   {move} {name}{self.gap()},v100\\V:=20, z10,"]
        out += [f"{end}     {tool}{wobj}; ! {self.umlauts()}{end}  ENDFOR{end}"]
        if self.chance(0.5):
            out += [
                "  MoveL \\Conc, ",
                *self.robtarget(tool, base),
                f"\\ID:=7,v50,fine,{tool}{wobj};{end}",
            ]
        if self.chance(0.3):
            out += ["  MoveC ", *self.robtarget(tool, base), ",", *self.robtarget(tool, base)]
            out += [f",v50,z1,{tool}{wobj};{end}"]
        if self.chance(0.4):
            head += [f"CONST robtarget a{name}{{2}}:=[", *self.robtarget(tool, base), ","]
            head += [*self.robtarget(tool, base), f"];{end}"]
            out += [f"  IF x>2 THEN MoveL a{name}{{i}},v50,z1,{tool}{wobj}; ENDIF{end}"]
        return out


class Fanuc(Maker):
    """TP as text: motions first, then the points."""

    letters, suffix = "wpr", ".ls"
    axes = np.deg2rad([10, 15, -20, 30, -50, 40])
    tool_names, base_names = ("1", "2"), ("0", "4")
    exponents = plus = False

    def __init__(self, seed, robot, bending):
        super().__init__(seed, robot, bending)
        self.bare = self.chance(0.7)
        self.bases["0"] = [0.0, 0.0, 670.0, 0.0, 0.0, 0.0]

    def digits(self, k, kind):
        """Three, as the controller writes them, or four."""
        return self.word_digits

    @property
    def word_digits(self):
        """Three decimals mostly."""
        return 3 if self.chance(0.8) else 4

    def position(self, number, kind):
        """A point of /POS."""
        tool, base = self.word(*self.tool_names), self.word(*self.base_names)
        point, values = self.next(kind, tool, base)
        end = self.end
        label = self.word("", f':"{self.word("Anfang", "Höhe 2")}"')
        out = [f"P[{number}{label}]{{{end}   GP1:{end}\tUF : {base}, UT : {tool},\t"]
        names = "J1 J2 J3 J4 J5 J6" if kind == "joint" else "X Y Z W P R"
        out += ["" if kind == "joint" else "\tCONFIG : 'N U T, 0, 0, 0',", end]
        for k, (name, value) in enumerate(zip(names.split(), values, strict=True)):
            unit = "mm" if kind != "joint" and k < 3 else "deg"
            comma = "" if k == 0 else self.word(",\t", f",{end}\t")
            out += [f"{comma}\t{name}{self.gap(1)}={self.gap(1)}", self.coordinate(point, k, value)]
            out += [f"{self.gap(1)}{unit}"]
        if self.rail:
            out += [f",{end}\tE1=  {self.points[point].external}  mm"]
        if self.chance(0.3):
            out += [f"{end}   GP2:{end}\tUF : 0, UT : 1,\t{end}\tJ1=    12.500 deg"]
        return [*out, f"{end}}};{end}"]

    def make(self):
        """The program."""
        end, lines, positions = self.end, [], []
        head = [f'/PROG  PROBE{end}/ATTR{end}OWNER\t\t= MNEDITOR;{end}COMMENT\t\t= "Fräsen";{end}']
        head += [f"DEFAULT_GROUP\t= 1,*,*,*,*;{end}/MN{end}"]
        for number in range(1, int(self.rng.integers(5, 10))):
            kind = "joint" if number == 1 or self.chance(0.2) else "pose"
            positions += self.position(number, kind)
            if self.chance(0.4):
                lines += [f"!{self.umlauts()} P[{number}]"]
            speed = "J P[{}] 50% FINE" if kind == "joint" else "L P[{}] 250mm/sec CNT50"
            speed = speed.format(
                f"{number}:{self.word('Anfang', 'Ende')}" if self.chance(0.3) else number
            )
            lines += [speed + self.word("    ", f"{end}    :  ACC80  ")]
        lines += ["L P[2] 250mm/sec FINE Offset,PR[1]    ", "L PR[3] 250mm/sec FINE    "]
        lines += ["L P[R[1]] 250mm/sec FINE    ", "JMP LBL[1] ", "R[2]=R[2]+1    "]
        body = "".join(f"{k:4d}:{line};{end}" for k, line in enumerate(lines, 1))
        tool, base = (
            self.given(self.tools, self.tool_names),
            self.given(self.bases, self.base_names),
        )
        words = [*head, body, f"/POS{end}", *positions, f"/END{end}"]
        return self.made({"probe.ls": words}, tool=tool, base=base)


class Ur(Maker):
    """URScript: poses and joints in the calls, and in variables."""

    letters, joints, suffix = "vector", "rad", ".script"
    axes = np.array([0.3, -1.2, 1.4, -1.8, -1.5, 0.2])
    tool_names, base_names = ("tcp",), ("",)

    def __init__(self, seed, robot, bending):
        super().__init__(seed, robot, bending)
        self.bases[""] = [0.0] * 6

    def digits(self, k, kind):
        """Metres and radians."""
        return int(self.rng.integers(5, 9))

    def value(self, kind):
        """A pose or six joints."""
        point, values = self.next(kind, "tcp", "")
        out = ["[" if kind == "joint" else self.word("p[", "p[ ")]
        for k, value in enumerate(values):
            comma = "" if k == 0 else self.word(",", ", ", f",{self.end}      ")
            out += [comma, self.coordinate(point, k, value)]
        return [*out, self.gap() + "]"]

    def make(self):
        """The script."""
        end, out = self.end, [f"def probe():{self.end}"]
        tcp = ", ".join(map(repr, self.tools["tcp"]))
        if self.chance(0.5):
            out += [f"  set_tcp(p[{tcp}])  # {self.umlauts()}{end}"]
        else:
            out += [f"  global tcp = p[{tcp}]{end}  set_tcp(tcp){end}"]
        out += ["  movej(", *self.value("joint"), f", a=1.4, v=1.05, t=0, r=0){end}"]
        for number in range(int(self.rng.integers(3, 7))):
            out += self.motions(f"Waypoint_{number}")
        out += [f"  movel(pose_trans(Waypoint_0_p, p[0,0,0.05,0,0,0]), a=1.2, v=0.25){end}"]
        out += [f'  textmsg("movel(p[1,2,3,0,0,0])"){end}  q = get_actual_joint_positions(){end}']
        return self.made({"probe.script": [*out, f"end{end}"]})

    def motions(self, name):
        """A variable and motions to it, and poses in the calls."""
        end, out = self.end, []
        out += [f"  {self.word('global ', 'local ', '')}{name}_p{self.gap()}={self.gap()}"]
        out += [*self.value("pose"), f"  # {self.umlauts()}{end}"]
        out += [f"  while i < 3:{end}    movel({self.gap()}{name}_p, a=1.2, v=0.25){end}  end{end}"]
        if self.chance(0.5):
            out += [
                f"  {self.word('movel', 'movep', 'movej')}(",
                *self.value("pose"),
                f", a=1, v=0.1){end}",
            ]
        if self.chance(0.3):
            out += ["  movec(", *self.value("pose"), ", ", *self.value("pose"), f", a=1){end}"]
        if self.chance(0.3):
            near = ", ".join(f"{v:.4f}" for v in self.last)
            out += [
                "  movej(get_inverse_kin(",
                *self.value("pose"),
                f", qnear=[{near}]), a=1.4){end}",
            ]
        if self.chance(0.3):
            out += ["  movej(", *self.value("joint"), f"){end}"]
        return out
