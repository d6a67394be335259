"""Nothing of a robot program is overlooked: every motion is corrected or listed, or all is refused.

What stands in the programs is written by hand from the controllers' manuals; what is expected of
each is the lines that are corrected and those that are listed, told by eye.
"""

import re

import pytest
from test_program_words import KR, NO_TOOL, START, Q, kuka, pose_at  # noqa: F401
from test_programs import identified

from bench import bench_programs
from pipeline.app import cli
from pipeline.base.errors import InputError
from pipeline.programs import read

K = "{X 2000.0,Y 3000.0,Z 1500.0,A 10.0,B 60.0,C 5.0}"
HEX = K.replace("2000.0", "'H9C0'")
AXES = "{A1 0,A2 -90,A3 90,A4 0,A5 10,A6 0}"
FRAME = "{X 1,Y 2,Z 3,A 0,B 0,C 0}"
SET = "$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[1]\n"
R = "[[1200,0,800.5],[0,0,1,0],[0,0,-1,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
TOOL = "PERS tooldata t:=[TRUE,[[0,0,200],[1,0,0,0]],[1,[0,0,0],[1,0,0,0],0,0,0]];"
SIX = "[0.1,-1.57,1.57,0.2,1.57,.3]"
U = "p[0.4,0.2,0.3,0,3.14,0]"


def rapid(*lines):
    """A module whose motion to p10 stands in line 4."""
    head = ["MODULE M", TOOL, f"CONST robtarget p10:={R};PROC main()", "MoveL p10,v1,z1,t;"]
    return "\n".join([*head, *lines, "ENDPROC", "ENDMODULE"])


def tp(*lines, names=("1", "2")):
    """A TP program with points of tool 2 in frame 1."""
    words = "".join(f"{k}:{line} ;\n" for k, line in enumerate(lines, 1))
    pose = "\n GP1:\n UF : 1, UT : 2,\n X = 5.0 mm, Y = .0 mm, Z = 1.0 mm, W = .0 deg, P = 1.0 deg,"
    points = "".join(f"P[{name}]{{{pose} R = 1.0 deg\n}};\n" for name in names)
    return f"/MN\n{words}/POS\n{points}"


def script(*lines):
    """A script whose first motion stands in line 2."""
    return "\n".join(["def p():", f"  movel({U})", *lines, "end", ""])


CASES = {
    # KRL: file, text, lines of what is corrected, lines of what is left
    "with a tool": ("p.src", f"{SET}SLIN {K} WITH $TOOL=foo()\nLIN {K}", [4], [3]),
    "with a load": ("p.src", f"{SET}SLIN {K} WITH $LOAD=L\nLIN {K}", [4], [3]),
    "tool by a variable": ("p.src", f"{SET}LIN {K}\nBAS(#TOOL,N)\nLIN {K}", [3], [5]),
    "data by a variable": ("p.src", f"{SET}LIN {K}\n$TOOL=TOOL_DATA[N]\nLIN {K}", [3], [5]),
    "tool in a branch": (
        "p.src", f"{SET}LIN {K}\nIF X THEN\n$TOOL=TOOL_DATA[2]\nENDIF\nLIN {K}", [3], [7],
    ),
    "tool in both branches": (
        "p.src", f"{SET}IF X THEN\nBAS(#TOOL,2)\nELSE\nBAS(#TOOL,2)\nENDIF\nLIN {K}", [8], [],
    ),
    "tool in a loop": (
        "p.src", f"{SET}LOOP\nLIN {K}\n$TOOL=TOOL_DATA[2]\nLIN {K}\nENDLOOP", [6], [4],
    ),
    "tool of a routine": (
        "p.src",
        f"DEF m()\n{SET}LIN {K}\ns()\nLIN {K}\nEND\nDEF s()\n$TOOL=TOOL_DATA[2]\nEND",
        [4], [6],
    ),
    "tool of the caller": (
        "p.src", f"DEF m()\n{SET}LIN {K}\nBAS(#TOOL,2)\ns()\nEND\nDEF s()\nLIN {K}\nEND", [4], [9],
    ),
    "tool of a routine in a loop": (
        "p.src",
        f"DEF m()\n{SET}LIN {K}\nREPEAT\nLIN {K}\nUNTIL s()\nEND\n"
        "DEFFCT BOOL s()\n$TOOL=TOOL_DATA[2]\nRETURN X\nENDFCT",
        [4], [6],
    ),
    "jump": ("p.src", f"{SET}LIN {K}\nL:\nLIN {K}\nBAS(#TOOL,2)\nGOTO L", [3], [5]),
    "by reference": ("p.src", f"{SET}LIN {K}\nP={K}\nLIN P\ncalib(P)", [3], [4]),
    "of the caller": ("p.src", f"{SET}LIN {K}\nP={K}\nLIN P\nDEF s(P:OUT)\nEND", [3], [4]),
    "byte order mark": ("p.src", f"\xef\xbb\xbfLIN {K}\nLIN {K}", [1, 2], []),
    "point for a routine": ("p.src", f"{SET}LIN {K}\nweld({K})", [3], [4]),
    "part of a point": ("p.src", f"{SET}LIN {K}\nP={K}\nP={{Z 5}}\nLIN P", [3], [6]),
    "motion in a branch": ("p.src", f"{SET}LIN {K}\nIF X THEN LIN {K} ENDIF", [3], [4]),
    "asynchronous": ("p.src", f"{SET}LIN {K}\nASYPTP {{A1 5}}", [3], [4]),
    "hexadecimal": ("p.src", f"{SET}LIN {HEX}", [3], []),
    "letter of another language": ("p.src", f"{SET}LIN {K}\nLIN {{X 1D3,Y 1}}", [3], [4]),
    "distance first": ("p.src", f"LIN_REL {{Z 1}}\n{SET}LIN {K}", [4], [1]),
    "distance behind": ("p.src", f"{SET}LIN {K}\nLIN_REL {{Z 1}}\nPTP XHOME", [3], []),
    "spline": ("p.src", f"{SET}SPLINE WITH $BASE={FRAME}\nSPL {K}\nENDSPLINE", [4], []),
    "part of any element": ("p.src", f"{SET}LIN {K}\nP[2]={K}\nP[I].Z=5\nLIN P[2]", [3], [4]),
    "any element": ("p.src", f"{SET}LIN {K}\nP[2]={K}\nP[I]={K}\nLIN P[2]", [3], [4, 5]),
    "elements for a routine": (
        "p.src", f"{SET}DECL POS P[9]\nLIN {K}\nP[2]={K}\nLIN P[2]\nweld(P[])", [4], [5],
    ),
    "in a structure": (
        "p.src", f"{SET}LIN {K}\nDECL MY S={{P1 {K},P2 {K}}}\nweld(S)", [3], [4],
    ),
    "load": ("p.src", f"{SET}LIN {K}\nDECL LOAD L={{M 5,CM {FRAME}}}\nload(L)", [3], []),
    "any tool of an array": (
        "p.src", f"{SET}LIN {K}\nT[2]={FRAME}\n$TOOL=T[2]\nLIN {K}\nT[I].X=5", [3], [6],
    ),
    "product of frames": ("p.src", f"{SET}LIN {K}\n$BASE=F1:F2\nLIN {K}", [3], [5]),
    "base that moves": ("p.src", f"{SET}LIN {K}\n$BASE=EK(R,T,E)\nLIN {K}", [3], [5]),
    "part of the base": ("p.src", f"{SET}LIN {K}\n$BASE.X=P.X\nLIN {K}", [3], [5]),
    "foot of the robot": ("p.src", f"{SET}LIN {K}\n$ROBROOT={FRAME}\nLIN {K}", [3], [5]),
    "point and base": ("p.src", f"P={K}\n{SET}LIN P\n$BASE=P\nLIN {K}", [6], [1]),
    "interpolation by a variable": (
        "p.src", f"{SET}LIN {K}\n$IPO_MODE=M\nLIN {K}", [3], [5],
    ),
    "loop left early": (
        "p.src",
        f"{SET}LOOP\nBAS(#TOOL,2)\nIF X THEN\nEXIT\nENDIF\nBAS(#TOOL,1)\nLIN {K}\nENDLOOP\n"
        f"LIN {K}",
        [9], [11],
    ),
    "tool behind THEN": ("p.src", f"{SET}LIN {K}\nIF X THEN BAS(#TOOL,2) ENDIF\nLIN {K}", [3], [5]),
    "tool behind a trigger": (
        "p.src", f"{SET}LIN {K}\nTRIGGER WHEN PATH=0 DELAY=0 DO $TOOL=T\nLIN {K}", [3], [5],
    ),
    "end of an arc": ("p.src", f"{SET}LIN {K}\nCIRC {K},P:{K}\n", [3], [4]),
    "via point of an arc": ("p.src", f"{SET}LIN {K}\nP={K}\nLIN P\nSCIRC Q,P", [3], [4, 6]),
    "arcs in a row": (
        "p.src",
        f"P={K}\nQ={K}\nS={K}\n{SET}LIN {K}\nCIRC P,Q\nCIRC Q,S\nCIRC {K},{K}\nCIRC S,X", [6, 9],
        [1, 2, 3, 10],
    ),
    "point of a spline": (
        "p.src",
        f"{SET}SPLINE\nSPL {K}\nSPL {K}\nSPL P\nENDSPLINE\nLIN {K}\nSPLINE\nSPL {K}\nENDSPLINE",
        [8, 10], [4, 5, 6],
    ),
    "word before a point": ("p.src", f"{SET}P={K}\nLIN {K}\nSPOT P,5\nLIN P", [4], [3]),
    "point that is read": (
        "p.src", f"{SET}P={K}\nLIN P\nIF P.X>5 THEN\nS=P.X+P.Y\nRETURN P\nENDIF", [3], [],
    ),
    "data behind other words": (
        "p.src",
        f"{SET}LIN {K}\n$BASE=BASE_DATA[2]\nLIN {K}\n"
        "INTERRUPT DECL 3 WHEN $IN[1] DO BASE_DATA[1].X=5\nIF BASE_DATA[2].X==5 THEN\nENDIF",
        [5], [3],
    ),
    "BAS by a variable": ("p.src", f"{SET}LIN {K}\nBAS(CMD,2)\nLIN {K}", [3], [5]),
    "velocity by BAS": ("p.src", f"{SET}LIN {K}\nBAS(#VEL_CP,2)\nLIN {K}", [3, 5], []),
    "form again": (
        "p.src",
        f"DECL FDAT F={{TOOL_NO 3,BASE_NO 4,IPO_FRAME #BASE}}\nFDAT_ACT=F\n$TOOL=TOOL_DATA[N]\n"
        f"LIN {K}\nBAS(#CP_PARAMS,1)\nLIN {K}",
        [6], [4],
    ),
    "form of nobody": ("p.src", f"{SET}LIN {K}\nBAS(#FRAMES)\nLIN {K}", [3], [5]),
    "tool for a routine": ("p.src", f"{SET}LIN {K}\nSREAD(S[],N,$TOOL.X)\nLIN {K}", [3], [5]),
    "twice in braces": ("p.src", f"{SET}LIN {K}\nLIN {K[:-1]},X 5}}", [3], [4]),
    "axes and pose": ("p.src", f"{SET}LIN {K}\nPTP {K[:-1]},A1 5}}", [3], [4]),
    "mark between files": ("p.src", f"{SET}LIN {K}\n\xef\xbb\xbfBAS(#TOOL,N)\nLIN {K}", [3], [5]),
    "word of nobody": ("p.src", f"{SET}LIN {K}\nLINX {K}\nGLUE{{A1 5}}", [3], [4, 5]),
    "index with a zero": ("p.src", f"{SET}LIN {K}\nP[1]={K}\nLIN P[1]\nP[01].Z=5", [3], [4]),
    "no-break space": ("p.src", f"{SET}LIN {K}\nLIN\xc2\xa0{K}", [3], [4]),
    "letters of another width": ("p.src", f"{SET}LIN {K}\n\xef\xbc\xac\xef\xbc\xa9 {K}", [3], [4]),
    "compared with": ("p.src", f"{SET}LIN {K}\nIF $POS_ACT=={K} THEN\nENDIF", [3], [4]),
    "product of points": ("p.src", f"{SET}LIN {K}\nP={K}:{K}\nLIN P", [3], [4, 5]),
    "product of the base": ("p.src", f"{SET}LIN {K}\n$BASE={FRAME}:{FRAME}\nLIN {K}", [3], [4, 5]),
    "part of a tool behind WITH": (
        "p.src", f"{SET}LIN {K}\nSLIN {K} WITH $TOOL.X=5\nLIN {K}", [3, 5], [4],
    ),
    "form in braces": (
        "p.src", f"{SET}FDAT_ACT={{TOOL_NO 3,BASE_NO N}}\nBAS(#FRAMES)\nPTP {AXES}\nLIN {K}",
        [5], [6],
    ),
    "routine without a main one": (
        "p.src", f"{SET}LIN {K}\ns()\nLIN {K}\nDEF s()\n$TOOL=TOOL_DATA[2]\nEND", [3], [5],
    ),
    # RAPID
    "handler that displaces nothing": (
        "m.mod", rapid("ERROR", "RETRY;", "ENDPROC", "PROC b()", f"MoveL {R},v1,z1,t;"), [3, 9], [],
    ),
    "displaced in short": ("m.mod", rapid("IF a PDispOn p10,t;", f"MoveL {R},v1,z1,t;"), [3], [6]),
    "short if": ("m.mod", rapid(f"IF a MoveL {R},v1,z1,t;"), [3, 5], []),
    "behind endif": ("m.mod", rapid(f"IF a THEN b; ENDIF MoveL {R},v1,z1,t;"), [3, 5], []),
    "end of an arc of RAPID": (
        "m.mod", rapid(f"MoveL {R},v1,z1,t;", "MoveC p10,Offs(p9,1,2,3),v1,z1,t;"), [5], [3, 6],
    ),
    "via point of an arc of RAPID": (
        "m.mod", rapid(f"MoveL {R},v1,z1,t;", "MoveC p9,p10,v1,z1,t;"), [5], [3, 6],
    ),
    "behind error": ("m.mod", rapid(f"ERROR MoveL {R},v1,z1,t;"), [3, 5], []),
    "behind proc": ("m.mod", rapid(f"ENDPROC PROC b() MoveL {R},v1,z1,t;"), [3, 5], []),
    "of packages": (
        "m.mod", rapid("CapL x,v1,z1,t;", "EGMMoveL y,x,v1;", "ArcL x,v1,s,w,z1,t;"),
        [3], [5, 6, 7],
    ),
    "of somebody": ("m.mod", rapid(f"Weld {R},5;"), [3], [5]),
    "of somebody elsewhere": ("m.mod", rapid("Weld x,v100,fine,t2;"), [3], [5]),
    "tool changed": ("m.mod", rapid(f"MoveL {R},v1,z1,tool0;", "t.tframe.trans.z:=5;"), [5], [3]),
    "target searched": (
        "m.mod", rapid(f"VAR robtarget p2:={R};", "SearchL d,p2,p10,v1,t;", "MoveL p2,v1,z1,t;"),
        [3], [5],
    ),
    "point changed": (
        "m.mod", rapid(f"MoveL {R},v1,z1,t;", "Incr p10.trans.x;"), [5], [3],
    ),
    "points of two routines": (
        "m.mod",
        rapid(f"MoveL {R},v1,z1,t;", "ENDPROC", "PROC b()", f"VAR robtarget p10:={R};"),
        [3, 5, 8], [],
    ),
    "displaced by a routine in a loop": (
        "m.mod",
        rapid("WHILE a DO", f"MoveL {R},v1,z1,t;", "b;", "ENDWHILE", "ENDPROC", "PROC b()",
              "PDispSet q;"),
        [3], [6],
    ),
    "displaced in an argument": (
        "m.mod",
        rapid(f"MoveL {R},v1\\V:=b(),z1,t;", "ENDPROC", "FUNC num b()", "PDispSet q;"),
        [3], [5],
    ),
    "routine by name": (
        "m.mod",
        rapid('%"b"%;', f"MoveL {R},v1,z1,t;", "ENDPROC", "PROC b()", "PDispSet q;"),
        [3], [6],
    ),
    "displaced by name": ("m.mod", rapid('%"PDispSet"% q;', f"MoveL {R},v1,z1,t;"), [3], [6]),
    "no more displaced by name": (
        "m.mod",
        rapid("PDispSet q;", f"MoveL {R},v1,z1,t;", '%"PDispOff"%;', f"MoveL {R},v1,z1,t;"),
        [3, 8], [6],
    ),
    "displaced by a computed name": (
        "m.mod", rapid("%name%;", f"MoveL {R},v1,z1,t;"), [3], [6],
    ),
    "displaced by a name in parts": (
        "m.mod", rapid('%"PD"+"ispSet"% q;', f"MoveL {R},v1,z1,t;"), [3], [6],
    ),
    "displaced by a name in a branch": (
        "m.mod", rapid("IF a THEN", "%name%;", "ENDIF", f"MoveL {R},v1,z1,t;"), [3], [8],
    ),
    "displaced by name in short": (
        "m.mod",
        rapid(f"MoveL {R},v1,z1,t;", 'IF a %"PDispSet"% q;', "ENDPROC", "PROC b()",
              f"MoveL {R},v1,z1,t;"),
        [3, 5], [9],
    ),
    "a part of many by name": (
        "m.mod", rapid('%"part"+NumToStr(n,0)%;', f"MoveL {R},v1,z1,t;"), [3, 6], [],
    ),
    "head of a file": (
        "m.mod", "%%%\n VERSION:1\n LANGUAGE:ENGLISH\n%%%\n" + rapid(f"MoveL {R},v1,z1,t;"),
        [7, 9], [],
    ),
    "data by name": (
        "m.mod",
        rapid(f"VAR robtarget p2:={R};", 'SetDataVal "p2",x;', f"MoveL {R},v1,z1,t;",
              "MoveL p2,v1,z1,t;"),
        [7], [3, 5],
    ),
    "work object of an option": ("m.mod", rapid(f"MoveL {R},v1,z1,t\\WObj?w;"), [3], [5]),
    "option of somebody": (
        "m.mod", rapid(f"VAR robtarget p2:={R};", "weld\\at:=p2;", "MoveL p2,v1,z1,t;"), [3], [5],
    ),
    "in a record": ("m.mod", rapid(f"VAR rec s:=[{R},5];", "weld s;"), [3], [5]),
    "with outputs": ("m.mod", rapid("TriggLIOs x,v1,\\TriggData1:=d,z1,t;"), [3], [5]),
    "recorded": ("m.mod", rapid("PathRecMoveBwd;"), [3], [5]),
    "only prepared": ("m.mod", rapid("TriggIO g,5\\DOp:=d,1;"), [3], []),
    # FANUC
    "offset without a colon": (
        "p.ls", tp("L P[1] 5mm/sec FINE", "L P[2] 9mm/sec FINE\n   Tool_Offset"), [6], [3],
    ),
    "set on a broken line": (
        "p.ls", tp("J P[3] 5% FINE", "L P[1] 5mm/sec FINE", names=("1", "3"))
        .replace("\n2:L", "\nUTOOL[2]=PR[1]\n2:L").replace("UT : 2", "UT : 3", 1), [6], [2, 3],
    ),
    "end of an arc of TP": (
        "p.ls", tp("L P[2] 5mm/sec FINE", "C P[2]\n  : PR[2] 5mm/sec FINE", "L P[1] 5mm/sec FINE"),
        [7], [3, 12],
    ),
    "via point of an arc of TP": (
        "p.ls", tp("C P[1]\n  : P[3] 5mm/sec FINE", "L P[2] 5mm/sec FINE"), [11], [2, 6],
    ),
    "arc of three statements": (
        "p.ls",
        tp("A P[1] 5mm/sec FINE", "A PR[2] 5mm/sec FINE", "L P[2] 5mm/sec FINE"), [11], [3, 6],
    ),
    "no position": ("p.ls", tp("L P[1] 5mm/sec FINE", "L P[7] 5mm/sec FINE"), [5], [3]),
    "bracket in a name": (
        "p.ls",
        tp("L P[1] 5mm/sec FINE", "L P[2:a]b] 5mm/sec FINE", names=("1", '2:"a]b"')), [5, 10], [],
    ),
    "tool set": ("p.ls", tp("UTOOL[3]=PR[1]", "L P[1] 5mm/sec FINE"), [5], []),
    "remote tool": ("p.ls", tp("L P[1] 5mm/sec FINE", "L P[2] 9mm/sec FINE RTCP"), [5], [3]),
    "without a colon": ("p.ls", tp("L P[1] 5mm/sec FINE", "C P[1]\n   P[2] 5mm/sec"), [6], [4]),
    # UR
    "word before a point of a script": (
        "p.script", script(f"  a={U}", "  movel(a)", "  weld a, 5", "  return a"), [2], [3],
    ),
    "end of an arc of a script": ("p.script", script(f"  movec({U},pose_trans(a,b))"), [2], [3]),
    "via point of an arc of a script": (
        "p.script", script(f"  a={U}", "  movel(a)", f"  movec(pose_trans(b,{U}),a)"), [2], [3, 5],
    ),
    "other move": ("p.script", script(f"  optimovel({U},0.5)"), [2], [3]),
    "force": ("p.script", script("  force_mode(f,[1],[1],2,[1])"), [2], [3]),
    "joints for a routine": (
        "p.script", script(f"  go(q={SIX})", "  x.go([d2r(5),1,2,3,4,5])"), [2], [3, 4],
    ),
    "joints in a value": (
        "p.script", script(f"  s=struct(q={SIX})", f"  return {SIX}"), [2], [3, 4],
    ),
    "six numbers of no place": (
        "p.script", script(f"  set_payload(1.5,[0,0,0],{SIX})"), [2], [],
    ),
    "handed over": ("p.script", script(f"  a={U}", "  movel(a)", "  weld(a)"), [2], [3]),
    "tool in an if": (
        "p.script", script("  if x:", f"    set_tcp({U})", "  end", f"  movel({U})"), [2], [6],
    ),
    "tool of a routine in a loop of a script": (
        "p.script",
        script("  while x:", f"    movel({U})", "    t()", "  end", "end", "def t():",
               f"  set_tcp({U})"),
        [2], [4],
    ),
    "tool in an argument": (
        "p.script",
        script(f"  movel({U},t())", "end", "def t():", f"  set_tcp({U})"),
        [2], [3],
    ),
    "tool in a case with an end": (
        "p.script",
        script("  switch x:", "  case 1:", f"    set_tcp({U})", "  end", "  end", f"  movel({U})"),
        [2], [8],
    ),
    "tool in an if of one line": (
        "p.script", script(f"  if x: set_tcp({U}) end", f"  movel({U})"), [2], [4],
    ),
    "element": ("p.script", script(f"  m=[{U}]", "  m[0][2]=0.5", "  movel(m[0])"), [2], [3]),
    "point and tool": ("p.script", script(f"  a={U}", "  set_tcp(a)", "  movel(a)"), [2], [3]),
    "bare carriage return": (
        "p.script", script(f"  a={U}", "  movel(a)", "  b=2\r  a[2]=0.5"), [2], [3],
    ),
    "another tool": ("p.script", script(f"  movej(get_inverse_kin({U},tcp={U}))"), [2], [3]),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_every_motion_is_corrected_or_listed(name):
    """Lines of targets, and lines of what moves the tool as taught, as a reader counts them."""
    file, text, corrected, left = CASES[name]
    found = read(file, text.encode("latin-1"))

    assert sorted({one.line for one in found.targets}) == corrected
    assert sorted({one.line for one in found.left if one.counts}) == left


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("p.src", f"{SET}LIN {K}\nTOOL_DATA[1].Z=5\n"),
        ("p.src", f"{SET}LIN {K}\nTOOL_DATA[01].Z=5\n"),
        ("p.src", f"{SET}LIN {K}\nTOOL_DATA[1]=TOOL_DATA[2]:c\n"),
        ("p.src", f"TOOL_DATA[1]={FRAME}\n{SET}LIN {K}\nTOOL_DATA[1]={FRAME}\n"),
        ("p.src", f"TOOL_DATA[N]={FRAME}\n{SET}LIN {K}\n"),
        ("p.src", f"{SET}LIN {K}\nmeasure(TOOL_DATA[1])\n"),
        ("m.mod", rapid("t:=t2;")),
        ("m.mod", rapid(f"MoveL {R},v1,z1,t;", "ERROR", "PDispSet q;", "RETRY;")),
        ("m.mod", rapid("ERROR", "mend;", "TRYNEXT;", "ENDPROC", "PROC mend()", "PDispSet q;")),
        ("p.ls", tp("UTOOL[2]=PR[1]", "L P[1] 5mm/sec FINE")),
        ("p.ls", tp("UFRAME_NUM=R[1]", "L P[1] 5mm/sec FINE")),
        ("p.ls", tp("P[R[1]]=PR[2]", "L P[1] 5mm/sec FINE")),
        ("p.ls", tp("$MNUTOOL[1,2].$X=5", "L P[1] 5mm/sec FINE")),
        ("p.ls", tp("UTOOL_NUM=3", "L P[1] 5mm/sec FINE").replace("UT : 2", "UT : F")),
        (
            "p.script",
            script("end", "thread t():", f"  set_tcp({U})").replace("\n", "\r"),
        ),
        (
            "p.src",
            f"DEF m()\nINTERRUPT DECL 3 WHEN $IN[1] DO s()\n{SET}LIN {K}\nEND\n"
            "DEF s()\nBAS(#TOOL,2)\nEND",
        ),
        ("p.src", f"INTERRUPT DECL 3 WHEN $IN[1] DO $BASE=BASE_DATA[2]\n{SET}LIN {K}"),
        (
            "p.src",
            f"DEF m()\n{SET}INTERRUPT DECL 3 WHEN X DO BAS(#TOOL,2)\nBAS(#TOOL,1)\nLIN {K}\nEND",
        ),
        ("m.mod", rapid("ENDPROC", "TRAP tr", "PDispOn p10,t;", "ENDTRAP", "PROC q()")),
        (
            "p.script",
            f"def p():\nthread t():\nset_tcp({U})\nend\nrun t()\nset_tcp({U})\nmovel({U})\nend\n",
        ),
        ("p.script", f"def p():\nwhile x:\nmovel({U})\nset_tcp({U})\nend\nend"),
    ],
)
def test_nothing_is_corrected_with_a_frame_that_changes(file, text):
    """The tool of the only motion is another one at another time: there is nothing to correct."""
    with pytest.raises(InputError, match=f"{file}:.*none of its targets can be corrected"):
        read(file, text.encode())


def test_a_point_that_nothing_goes_to_is_told_and_one_that_is_computed_with_counts():
    """A spare point moves nothing; what is computed from another one is moved to elsewhere."""
    dat = f"DEFDAT p\nDECL POS SPARE={K}\nDECL POS READ={K}\nENDDAT\n"
    found = read("p.src", f"{SET}LIN {K}\nP2=READ\n".encode(), ("p.dat", dat.encode()))

    assert [(one.line, one.counts) for one in found.elsewhere] == [(2, False), (3, True)]


def test_a_list_that_is_assigned_again_is_moved_to_as_a_whole():
    """Which of both `a[1]` is, depends on when: each point of either counts as its target."""
    other = U.replace("0.4", "0.5", 1)
    text = script(f"  a=[{U},{U}]", "  movel(a[1])", f"  a=[{other},{other}]", "  movel(a[1])")

    assert [one.line for one in read("p.script", text.encode()).targets] == [2, 3, 3, 5, 5]


def test_a_form_of_spline_motions_names_its_tool_and_base():
    """What KSS writes behind WITH is understood, and holds for this motion alone."""
    dat = "DECL FDAT F={TOOL_NO 3,BASE_NO 4,IPO_FRAME #BASE}\n"
    words = "$VEL=SVEL_CP(2.0, , L),$TOOL=STOOL2(F),$BASE = SBASE(F.BASE_NO),$LOAD=SLOAD(F.TOOL_NO)"
    text = f"{dat}{SET}SLIN {K} WITH {words},$IPO_MODE=SIPO_MODE(F.IPO_FRAME)\nLIN {K}\n"

    assert [(one.tool, one.base) for one in read("p.src", text.encode()).targets] == [
        ("3", "4"),
        ("1", "1"),
    ]


@pytest.mark.parametrize(("file", "head", "again"), bench_programs.TEXTS)
def test_what_nobody_would_write_is_refused(file, head, again):
    """With its line, and by no error of ours; `make bench ARGS=programs` measures how soon."""
    with pytest.raises(InputError):
        read(file, bench_programs.written(head, again, 5_000))


# --- on disk --------------------------------------------------------------------------------------


@pytest.fixture
def typed(kuka, capsys):  # noqa: F811
    """Type a correction of p.src: the exit code and what was said."""

    def run(text, out="out.src", *more, file="p.src"):
        if text is not None:
            (kuka.root / file).write_text(text)
        words = ["compensate", KR.name, str(kuka.root / file), "--force", "0,0,-900"]
        words += ["--start", START, "--tool", "0,0,0,0,0,0", "--base", "0,0,0,0,0,0"]
        words += ["--output", str(kuka.root / out), "--root", str(kuka.root), *more]
        return cli._exit_code(words), capsys.readouterr().err

    run.root, run.point = kuka.root, pose_at(kuka.bending, Q)
    return run


def test_half_of_a_program_is_written_only_where_it_is_asked_for(typed):
    """A computed motion: exit code 5 and no file; with --partial the file, and the line is told.

    An arc whose end is computed keeps its via point.
    """
    arc = typed.point.replace("PTP", "CIRC").replace("LIN", "CIRC").rstrip() + ",XP1:{X 1}\n"
    text = typed.point + "LIN XP1:{X 1}\n" + arc
    code, said = typed(text)

    assert code == 5
    assert re.search(r"p\.src:2: XP1:\{X 1\} is computed .*--partial", said.replace("\n", " "))
    assert not (typed.root / "out.src").exists()
    code, said = typed(text, "out.src", "--partial")
    assert code == 0
    assert "p.src:2: XP1:{X 1} is computed at run time; it is not corrected." in said
    assert (typed.root / "out.src").read_text().endswith("\nLIN XP1:{X 1}\n" + arc)
    assert typed.point not in (typed.root / "out.src").read_text()


def test_no_target_moves_farther_than_is_plausible(typed):
    """Beyond --max-offset exit code 5 with line and size, and no file; within it the program."""
    code, said = typed(typed.point, "out.src", "--max-offset", "0.5")

    assert code == 5
    shift = re.search(
        r"p\.src:1: .* would move by (\S+) mm, more than --max-offset 0\.5 mm",
        said.replace("\n", " "),
    )
    assert float(shift[1]) > 0.5
    assert not (typed.root / "out.src").exists()
    code, _ = typed(None, "out.src", "--max-offset", f"{float(shift[1]) + 0.01}")
    assert code == 0
    assert (typed.root / "out.src").exists()
    assert typed(None, "out.src", "--max-offset", "nan")[0] == 2


def test_the_original_is_not_written_over(typed):
    """Onto itself, by a link, or onto its other file: exit code 5, and both stay."""
    (typed.root / "p.dat").write_text("DEFDAT p\nENDDAT\n")
    typed(typed.point)
    (typed.root / "link.src").hardlink_to(typed.root / "p.src")
    for out in ("p.src", "link.src", "p.dat"):
        code, said = typed(None, out)
        assert code == 5
        assert "the original, which --output would overwrite; write to another file" in said
    assert (typed.root / "p.src").read_text() == typed.point
    assert (typed.root / "p.dat").read_text() == "DEFDAT p\nENDDAT\n"


def test_what_is_corrected_says_so_and_is_not_corrected_again(typed):
    """Campaign, force and date in the file; a second time exit code 5 and nothing written."""
    head = "&ACCESS RVP\n&REL 1\nDEF p( )\n"
    assert typed(head + typed.point + "END\n")[0] == 0
    lines = (typed.root / "out.src").read_text().splitlines()

    assert "\n".join(lines[:3]) + "\n" == head
    assert re.fullmatch(
        r"; Corrected for the load by pipeline \S+: campaign kr500_rail, model \w{12}, "
        r"force 0,0,-900 N in base, \d{4}-\d\d-\d\d, text \w{12}",
        lines[3],
    )
    code, said = typed(None, "twice.src", file="out.src")
    assert code == 5
    assert "out.src:4: is corrected for the load already; correct the original instead" in said
    assert not (typed.root / "twice.src").exists()


@pytest.mark.parametrize(
    ("file", "text", "before"),
    [
        ("p.mod", f"%%%\nVERSION:1\n%%%\nMODULE M(SYSMODULE)\nMoveL {R},v1,z1,tool0;\nENDMODULE\n",
         "%%%\nVERSION:1\n%%%\nMODULE M(SYSMODULE)\n! Corrected"),
        ("p.script", f"def p():\r\n  movel({U})\r\nend\r\n", "def p():\r\n# Corrected"),
        ("p.dat", f"&REL 1\r\nDEFDAT p\r\nDECL POS P={K}\r\nENDDAT\r\n",
         "&REL 1\r\nDEFDAT p\r\n; Corrected"),
        ("p.src", f"&REL 1\nLIN {K}\n", "&REL 1\n; Corrected"),
    ],
)  # fmt: skip
def test_the_remark_stands_where_the_language_takes_one(file, text, before):
    """Below the head, in the line ends of the file, and it is found again."""
    from pipeline.programs.stamp import refuse, stamped, words

    said = words("1.0", "c", b"m", "0,0,1 N in base", "2026-01-01", text)
    new = stamped(file, text, said)

    assert new.startswith(before)
    assert len(re.split(r"\r\n|\n", new)) == len(re.split(r"\r\n|\n", text)) + 1
    assert ("\r\n" in text) == (new.count("\r\n") == new.count("\n"))
    with pytest.raises(InputError, match="is corrected for the load already"):
        refuse(file, new)
    assert read(file, text.encode()).targets


def test_no_line_of_a_tp_program_gets_another_number():
    """Remarks of at most 32 letters behind the last line, counted in the attributes."""
    from pipeline.programs.stamp import refuse, stamped, words

    text = "/ATTR\nLINE_COUNT\t= 2;\n" + tp("L P[1] 5mm/sec FINE", "JMP LBL[1]")
    new = stamped("p.ls", text, words("1.0", "long" * 20, b"m", "0,0,1", "2026-01-01", text))
    remarks = re.findall(r"^ +(\d+):  !(.*) ;$", new, re.MULTILINE)

    assert new.index("JMP LBL") < new.index("3:  !|Corrected") < new.index("/POS")
    assert [int(k) for k, _ in remarks] == list(range(3, 3 + len(remarks)))
    assert all(len(said) <= 32 for _, said in remarks)
    assert f"LINE_COUNT\t= {2 + len(remarks)};" in new
    with pytest.raises(InputError, match="already"):
        refuse("p.ls", new)
    assert [one.name for one in read("p.ls", text.encode()).targets] == ["P[1]"]


def test_a_corrected_path_is_not_corrected_again(tmp_path, capsys):
    """The answer to a path has columns that no path has."""
    identified(tmp_path, KR)
    (tmp_path / "path.csv").write_text("pose,x_mm,y_mm,z_mm,corrected\n1,1,2,3,so\n")
    words = ["compensate", KR.name, str(tmp_path / "path.csv"), "--root", str(tmp_path)]

    assert cli._exit_code(words) == 5
    assert "path.csv: is corrected for the load already" in capsys.readouterr().err
