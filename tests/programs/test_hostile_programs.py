"""Programs written to lose a motion: every taught point and every word like a motion is accounted.

They were written from the manuals of the four languages before the parsers were looked at. What is
asked of each: a line that moves is a target, or listed, or goes to a point that is; and no point is
a target whose tool, frame or coordinates nobody knows.
"""

import re

import pytest

from pipeline import programs
from pipeline.programs import krl as of_kuka
from pipeline.programs import rapid as of_abb
from pipeline.programs import tp as of_fanuc
from pipeline.programs import urscript as of_ur
from pipeline.programs._text import one_byte_characters


def kp(x, y=200.0, z=1200.0):
    return f"{{X {x},Y {y},Z {z},A 0.0,B 90.0,C 0.0,S 2,T 10}}"


K = {}


def krl(name, body, must=(), never=()):
    K[name] = (body, must, never)


krl(
    "inline_function_arg",
    f"""DEF A()
BAS(#INITMOV,0)
LIN {kp(1500.0)}
SEAM({kp(1510.0)},3)
END
DEF SEAM(P:IN,N:IN)
E6POS P
INT N
LIN P
END
""",
    must=("LIN {X 1500", "SEAM(", "LIN P\n"),
)
krl(
    "point_in_loop",
    f"""DEF A()
DECL E6POS P
INT I
P={kp(1500.0)}
FOR I=1 TO 3
P.X=P.X+10
LIN P C_DIS
ENDFOR
END
""",
    must=("LIN P C_DIS",),
    never=("P={X",),
)
krl(
    "geometric_operator",
    f"""DEF A()
DECL FRAME F
LIN {kp(1500.0)}
LIN {kp(1500.0)}:{{X 0,Y 0,Z 50,A 0,B 0,C 0}}
LIN $POS_ACT:{{X 0,Y 0,Z 50,A 0,B 0,C 0}}
END
""",
    must=(
        "LIN {X 1500.0,Y 200.0,Z 1200.0,A 0.0,B 90.0,C 0.0,S 2,T 10}\n",
        ":{X 0,Y 0,Z 50",
        "$POS_ACT",
    ),
)
krl(
    "spline_block",
    f"""DEF A()
PTP {kp(1400.0)}
SPLINE WITH $VEL.CP=0.2
SPL {kp(1500.0)}
SLIN {kp(1510.0)}
SCIRC {kp(1515.0, 210.0)},{kp(1520.0)},CA 45
TIME_BLOCK START
SPL {kp(1530.0)}
TIME_BLOCK END=2.0
ENDSPLINE
PTP_SPLINE
SPTP {kp(1400.0)}
ENDSPLINE
END
""",
    must=("PTP {", "SPL {X 1500", "SLIN", "SCIRC", "SPL {X 1530", "SPTP"),
)
krl(
    "lower_case_tabs",
    """&ACCESS RVO
def  a ( )
\tlin\t{x 1500.0, y 200.0, z 1200.0, a 0.0, b 90.0, c 0.0}\t; lin {x 1}
\tlin_rel {z 10} #tool
\tptp_rel {a1 3}
\tcirc_rel {x 5},{x 10}
end
""",
    must=("lin\t", "lin_rel", "ptp_rel", "circ_rel"),
)
krl(
    "asynchronous_and_trigger",
    f"""DEF A()
LIN {kp(1500.0)}
ASYPTP {{E1 500}}
TRIGGER WHEN DISTANCE=0 DELAY=0 DO GOBACK() PRIO=-1
LIN {kp(1520.0)}
END
DEF GOBACK()
LIN {kp(1450.0)}
END
""",
    must=("LIN {X 1500", "ASYPTP", "LIN {X 1520", "LIN {X 1450"),
)
krl(
    "if_on_one_point_two_tools",
    f"""DEF A()
$TOOL={{X 0,Y 0,Z 100,A 0,B 0,C 0}}
IF $IN[1] THEN
$TOOL={{X 0,Y 0,Z 300,A 0,B 0,C 0}}
ENDIF
LIN {kp(1500.0)}
END
""",
    must=("LIN {X 1500",),
    never=("LIN {X 1500",),
)
krl(
    "array_and_struct",
    f"""DEF A()
DECL E6POS P[3]
STRUC WELD E6POS AT, REAL V
DECL WELD W
P[1]={kp(1500.0)}
P[2]={kp(1510.0)}
W.AT={kp(1520.0)}
LIN P[1]
LIN P[I+1]
LIN W.AT
END
""",
    must=("LIN P[1]", "LIN P[I+1]", "LIN W.AT"),
)
krl(
    "goto_and_continuation",
    f"""DEF A()
GOTO L1
LIN {kp(1500.0)}
L1: LIN {kp(1510.0)}
CONTINUE
LIN {kp(1520.0)} C_PTP C_DIS
EXT  OTHER()
OTHER()
END
""",
    must=("LIN {X 1500", "L1: LIN", "LIN {X 1520"),
)
krl(
    "base_by_function_and_ipo",
    f"""DEF A()
$IPO_MODE=#TCP
LIN {kp(1500.0)}
$IPO_MODE=#BASE
$BASE=F_TISCH()
LIN {kp(1510.0)}
$ACT_BASE=3
LIN {kp(1520.0)}
END
""",
    must=("LIN {X 1500", "LIN {X 1510", "LIN {X 1520"),
    never=("LIN {X 1500", "LIN {X 1510"),
)
krl(
    "multiple_fold_same_name",
    """DEF A()
;FOLD LIN P1 Vel=2 m/s CPDAT1 Tool[1] Base[0];%{PE}
$BWDSTART=FALSE
LDAT_ACT=LCPDAT1
FDAT_ACT=FP1
BAS(#CP_PARAMS,2.0)
LIN XP1
;ENDFOLD
LIN XP9
END
""",
    must=("LIN XP1", "LIN XP9"),
)

R = {}


def rp(x, y=200, z=1200):
    return f"[[{x},{y},{z}],[0.70710678,0,0.70710678,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"


def rapid(name, body, must=(), never=()):
    R[name] = (f"MODULE M\n{body}ENDMODULE\n", must, never)


D = f"CONST robtarget p10:={rp(1500)};\nCONST robtarget p20:={rp(1510)};\n"
D += f"PERS robtarget pv:={rp(1520)};\n"
rapid(
    "late_binding",
    D
    + """PROC main()
MoveL p10,v100,fine,tool0;
%"MoveL"% p20,v100,fine,tool0;
%stProc% p20;
CallByVar "Weld",2;
ENDPROC
""",
    must=("MoveL p10", '%"MoveL"%', "%stProc%"),
)
rapid(
    "two_on_a_line",
    D
    + """PROC main()
MoveL p10,v100,fine,tool0; MoveL p20,v100,fine,tool0; MoveL pv,v100,fine,tool0;
ENDPROC
""",
    must=("MoveL p10",),
)
rapid(
    "functions_of_targets",
    D
    + """PROC main()
MoveL Offs(p10,0,0,50),v100,fine,tool0;
MoveL RelTool(p10,0,0,-5\\Rz:=30),v100,fine,tool0;
MoveL CRobT(),v100,fine,tool0;
MoveL MirPos(p20,wobj0),v100,fine,tool0;
MoveL [p10.trans,p10.rot,p10.robconf,p10.extax],v100,fine,tool0;
MoveAbsJ CalcJointT(p20,tool0)\\NoEOffs,v100,fine,tool0;
ENDPROC
""",
    must=("Offs(", "RelTool(", "CRobT", "MirPos", "[p10.trans", "CalcJointT"),
)
rapid(
    "parameter_and_alias",
    D
    + """ALIAS robtarget punkt;
VAR punkt a:=[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
PROC main()
go p10;
go2 p20\\fast;
MoveL a,v100,fine,tool0;
ENDPROC
PROC go(robtarget p)
MoveL p,v100,fine,tool0;
ENDPROC
PROC go2(PERS robtarget p\\switch fast)
MoveL p,v100,fine,tool0;
ENDPROC
""",
    must=("go p10", "go2 p20", "MoveL a", "MoveL p,"),
)
rapid(
    "changed_component",
    D
    + """PROC main()
pv.trans.z:=pv.trans.z+10;
MoveL pv,v100,fine,tool0;
MoveL p10,v100,fine,tool0;
pv:=p10;
MoveL pv,v100,fine,tool0;
ENDPROC
""",
    must=("MoveL pv", "MoveL p10"),
)
rapid(
    "other_motion_words",
    D
    + """PROC main()
TriggL p10,v100,tr1,fine,tool0;
SearchL di1,sp,p20,v100,tool0;
MoveLDO p10,v100,fine,tool0,do1,1;
MoveLSync p20,v100,fine,tool0,"weld";
ArcL p10,v100,seam1,weld1\\Weave:=wv,fine,tool0;
MoveExtJ jp1,v100,fine;
MoveC p10,p20,v100,fine,tool0;
SpotML p10,v100,gun1,spot1,tool0;
CSSDeactMoveL p10,v100,tool0;
ENDPROC
""",
    must=(
        "TriggL",
        "SearchL",
        "MoveLDO",
        "MoveLSync",
        "ArcL",
        "MoveExtJ",
        "MoveC",
        "SpotML",
        "CSSDeactMoveL",
    ),
)
rapid(
    "string_and_comment",
    D
    + """PROC main()
TPWrite "! no comment; MoveL p10,"; MoveL p20,v100,fine,tool0;
! MoveL p10,v100,fine,tool0;
MoveL
  p10,
  v100,fine,
  tool0;
ENDPROC
""",
    must=("MoveL p20", "  p10,"),
)
rapid(
    "displacement_conditional",
    D
    + """PROC main()
TEST n
CASE 1: PDispOn p10,tool0;
DEFAULT: PDispOff;
ENDTEST
MoveL p20,v100,fine,tool0;
ENDPROC
""",
    must=("MoveL p20",),
    never=("p20:=",),
)
rapid(
    "moving_workobject",
    D
    + """PERS wobjdata wobjConv:=[FALSE,FALSE,"CNV1",[[0,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
PERS tooldata tStat:=[FALSE,[[0,0,100],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];
PROC main()
MoveL p10,v100,fine,tool0\\WObj:=wobjConv;
MoveL p20,v100,fine,tStat;
MoveL \\Conc,pv,v100,fine,tool0;
ENDPROC
""",
    must=("MoveL p10", "MoveL p20", "MoveL \\Conc"),
    never=("p10:=", "p20:="),
)
rapid(
    "array_loop",
    """CONST robtarget seam{3}:=["""
    + ",".join(rp(1500 + k) for k in range(3))
    + """];
PROC main()
FOR i FROM 1 TO 3 DO
MoveL seam{i},v100,fine,tool0;
ENDFOR
MoveL seam{2},v100,fine,tool0;
WaitUntil di1=1; IF di2=1 MoveJ seam{1},v100,fine,tool0;
ENDPROC
""",
    must=("MoveL seam{i}", "MoveL seam{2}", "MoveJ seam{1}"),
)

T = {}


def fp(n, x=1500.0, y=200.0, z=1200.0, uf=0, ut=1, extra=""):
    head = f"P[{n}{extra}]{{\n   GP1:\n\tUF : {uf}, UT : {ut},\t\tCONFIG : 'N U T, 0, 0, 0',\n"
    at = f"\tX = {x:8.3f}  mm,\tY = {y:8.3f}  mm,\tZ = {z:8.3f}  mm,\n"
    return f"{head}{at}\tW = 180.000 deg,\tP =    0.000 deg,\tR =    0.000 deg\n}};\n"


def tp(name, lines, pos, must=(), never=()):
    body = (
        "/PROG  A\n/ATTR\nOWNER\t\t= MNEDITOR;\n/MN\n"
        + "".join(f"{k:4d}:{one}\n" for k, one in enumerate(lines, 1))
        + "/POS\n"
        + pos
        + "/END\n"
    )
    T[name] = (body, must, never)


tp(
    "offsets",
    [
        "J P[1] 100% FINE    ;",
        "L P[2] 100mm/sec FINE Offset,PR[1]    ;",
        "L P[3] 100mm/sec FINE Tool_Offset,PR[2]    ;",
        "OFFSET CONDITION PR[3]    ;",
        "L P[4] 100mm/sec FINE Offset    ;",
    ],
    "".join(fp(k, 1500 + k) for k in range(1, 5)),
    must=("J P[1]", "L P[2]", "L P[3]", "L P[4]"),
)
tp(
    "indirect",
    [
        "L P[R[1]] 100mm/sec FINE    ;",
        "L PR[3] 100mm/sec FINE    ;",
        "L PR[R[2]] 100mm/sec FINE    ;",
        "L P[2] R[5]mm/sec CNT R[6]    ;",
    ],
    fp(1) + fp(2, 1510.0),
    must=("L P[R[1]]", "L PR[3]", "L PR[R[2]]", "L P[2]"),
)
tp(
    "circle_two_lines",
    [
        "C P[1]    \n    :  P[2] 100mm/sec FINE    ;",
        "A P[3] 100mm/sec CNT100    ;",
        "A P[4] 100mm/sec CNT100    ;",
        "S P[5] 100mm/sec CNT50   ;",
    ],
    "".join(fp(k, 1500 + k) for k in range(1, 6)),
    must=("C P[1]", "P[2] 100", "A P[3]", "A P[4]", "S P[5]"),
)
tp(
    "incremental_and_skip",
    [
        "L P[1] 100mm/sec FINE INC    ;",
        "L P[2] 100mm/sec FINE Skip,LBL[2],PR[5]=LPOS    ;",
        "L P[3] 100mm/sec FINE COORD    ;",
        "L P[4] 100mm/sec FINE RTCP    ;",
        "L P[5] 100mm/sec FINE AP_LD50,RT_LD30    ;",
    ],
    "".join(fp(k, 1500 + k) for k in range(1, 6)),
    must=("L P[1]", "L P[2]", "L P[3]", "L P[4]", "L P[5]"),
    never=(),
)
tp(
    "named_points",
    [
        "L P[1:start; (a)] 100mm/sec FINE    ;",
        "L P[2:naht ]x] 100mm/sec FINE    ;",
        "  !L P[1] comment only    ;",
        "//L P[2] 100mm/sec FINE    ;",
    ],
    fp(1, extra=':"start; (a)"') + fp(2, 1510.0, extra=':"naht ]x"'),
    must=("L P[1:start", "L P[2:naht"),
)
tp(
    "frame_by_register",
    [
        "UFRAME_NUM=R[2]    ;",
        "UTOOL_NUM=1    ;",
        "L P[1] 100mm/sec FINE    ;",
        "UTOOL_NUM=AR[1]    ;",
        "L P[2] 100mm/sec FINE    ;",
    ],
    fp(1, uf="F", ut="F") + fp(2, 1510.0, uf="F", ut="F"),
    must=("L P[1]", "L P[2]"),
)
tp(
    "joint_points_and_two_groups",
    ["J P[1] 50% FINE    ;", "L P[2] 100mm/sec FINE    ;"],
    "P[1]{\n   GP1:\n\tUF : 0, UT : 1,\t\n\tJ1=     0.000 deg,\tJ2=   0.000 deg,\t"
    "J3=   0.000 deg,\n"
    "\tJ4=     0.000 deg,\tJ5=   -90.000 deg,\tJ6=   0.000 deg\n};\n"
    + fp(2).replace("};", "   GP2:\n\tUF : 0, UT : 1,\t\n\tJ1=    0.000 deg\n};"),
    must=("J P[1]", "L P[2]"),
)
tp(
    "motion_in_if_and_call",
    [
        "IF R[1]=1,JMP LBL[1]    ;",
        "IF (R[1]=1),CALL GOHOME    ;",
        "CALL WELD(1,'P[2]')    ;",
        "L P[1] 100mm/sec FINE TB .5sec,CALL MOVEX    ;",
        "LBL[1]    ;",
        "L P[2] 100mm/sec FINE    ;",
        "IF (DI[1]),L P[2] 100mm/sec FINE    ;",
    ],
    fp(1) + fp(2, 1510.0),
    must=("L P[1] 100", "L P[2] 100mm/sec FINE    ;", "IF (DI[1]),L"),
)
tp(
    "changed_point",
    [
        "PR[1]=P[2]    ;",
        "PR[1,3]=PR[1,3]+10    ;",
        "P[2]=PR[1]    ;",
        "L P[2] 100mm/sec FINE    ;",
        "L P[9] 100mm/sec FINE    ;",
    ],
    fp(1) + fp(2, 1510.0),
    must=("L P[2]", "L P[9]"),
    never=("X = 1510",),
)
tp(
    "weave_track_touch",
    [
        "Weave Sine[1]    ;",
        "Track TAST[1]    ;",
        "Arc Start[1]    ;",
        "L P[1] 100mm/sec FINE Search[X]    ;",
        "L P[2] WELD_SPEED CNT100 Arc End[1]    ;",
        "Touch Offset PR[4]    ;",
        "L P[1] 100mm/sec FINE    ;",
        "VOFFSET,VR[1]    ;",
        "L P[2] 100mm/sec FINE VOFFSET,VR[1]    ;",
    ],
    fp(1) + fp(2, 1510.0),
    must=("L P[1] 100mm/sec FINE Search", "L P[2] WELD", "L P[2] 100mm/sec FINE VOFFSET"),
)

U = {}


def ur(name, body, must=(), never=()):
    U[name] = (body, must, never)


pp = "p[0.5,0.2,0.4,0.0,3.1416,0.0]"
ur(
    "composed",
    f"""def a():
  movel(pose_trans({pp},p[0,0,0.05,0,0,0]),a=1.2,v=0.25)
  movej(get_inverse_kin({pp}),a=1.4,v=1.05)
  movel(pose_add({pp},p[0,0,0.1,0,0,0]))
  movel({pp})
end
""",
    must=("pose_trans", "get_inverse_kin", "pose_add", "movel(p[0.5"),
)
ur(
    "changed_waypoint",
    f"""def a():
  w={pp}
  i=0
  while i<3:
    w[2]=w[2]+0.01
    movel(w)
    i=i+1
  end
end
""",
    must=("movel(w)",),
    never=("w=p[",),
)
ur(
    "own_function",
    f"""def a():
  def mv(q,speed):
    movel(q,v=speed)
  end
  mv({pp},0.1)
  mv(p[0.5,0.2,0.41,0.0,3.1416,0.0],0.1)
end
""",
    must=("movel(q", "mv(p[0.5,0.2,0.4,", "mv(p[0.5,0.2,0.41"),
)
ur(
    "many_lines",
    f"""def a():
  movel(p[0.5,
    0.2, # x, ) y
    0.4,0.0,3.1416,0.0],
    a=1.2)
  textmsg("movel(p[1,2,3,0,0,0])")
  movec({pp},
     p[0.52,0.2,0.4,0.0,3.1416,0.0], r=0.01)
  movep({pp}) movel({pp})
end
""",
    must=("movel(p[0.5,\n", "movec(", "movep("),
)
ur(
    "servo_and_others",
    f"""def a():
  servoj([0,-1.57,1.57,-1.57,-1.57,0],t=0.1)
  speedl([0,0,-0.01,0,0,0],0.5,1)
  optimovel({pp},a=0.5)
  optimovej({pp})
  force_mode(tool_pose(),[0,0,1,0,0,0],[0,0,10,0,0,0],2,[0.1,0.1,0.15,0.2,0.2,0.2])
  movel({pp})
  tool_contact_move({pp})
  path_offset_set(p[0,0,0.01,0,0,0],1)
end
""",
    must=("servoj", "speedl", "optimovel", "optimovej", "movel(p", "tool_contact_move"),
)
ur(
    "array_of_poses",
    f"""def a():
  path=[{pp},p[0.51,0.2,0.4,0.0,3.1416,0.0]]
  i=0
  while i<2:
    movel(path[i],v=0.1)
    i=i+1
  end
  movel(path[0])
end
""",
    must=("movel(path[i]", "movel(path[0]"),
)
ur(
    "expressions",
    f"""def a():
  global h=0.4
  movel(p[0.5,0.2,h,0.0,d2r(180),0.0])
  movel(p[0.5+0.01,0.2,0.4,0.0,3.1416,0.0])
  movel(p[5e-1,.2,4.E-1,-0.,3.1416,0])
  if h>0.3: movel({pp}) end
end
""",
    must=("h,0.0,d2r", "0.5+0.01", "5e-1", "if h>0.3"),
)
ur(
    "tcp_by_variable",
    f"""def a():
  t=p[0,0,0.1,0,0,0]
  set_tcp(t)
  movel({pp})
  if digital_in(1):
    set_tcp(p[0,0,0.3,0,0,0])
  end
  movel(p[0.51,0.2,0.4,0.0,3.1416,0.0])
end
""",
    must=("movel(p[0.5,", "movel(p[0.51"),
    never=("movel(p[0.51",),
)
ur(
    "thread_and_global",
    f"""global p_a={pp}
thread mover():
  movel(p_a)
end
def a():
  run mover()
  movel(p_b)
  local p_c=p_a
  movel(p_c)
  p_a=get_actual_tcp_pose()
  movel(p_a)
end
""",
    must=("movel(p_a)", "movel(p_b)", "movel(p_c)"),
    never=("global p_a=",),
)
ur(
    "features",
    f"""def a():
  global Plane_1=p[1.0,0,0,0,0,0]
  movel(pose_trans(Plane_1,{pp}),v=0.1)
  $ 3 "MoveL"
  movel(struct(a={pp}).a)
  movel(interpolate_pose({pp},p[0.6,0.2,0.4,0.0,3.1416,0.0],0.5))
  move_linear({pp})
end
""",
    must=("pose_trans(Plane_1", "struct(", "interpolate_pose", "move_linear"),
)

krl(
    "shadow",
    f"""DEF A()
DECL E6POS P
P={kp(1500.0)}
LIN P
B()
END
DEF B()
DECL E6POS P
P={kp(1600.0)}
P.Z=P.Z+5
LIN P
END
""",
    must=("P={X 1500", "P={X 1600"),
)
krl(
    "conditional_assign",
    f"""DEF A()
DECL E6POS P
IF $IN[1] THEN
P={kp(1500.0)}
ELSE
P={kp(1510.0)}
ENDIF
LIN P
END
""",
    must=("P={X 1500", "P={X 1510"),
)
krl(
    "string_with_motion",
    f"""DEF A()
MSG[]="LIN P1 ; X 1"
LIN {kp(1500.0)} ; "
LIN {kp(1510.0)}
END
""",
    must=("LIN {X 1500", "LIN {X 1510"),
)
krl(
    "pointer_out",
    f"""DEF A()
DECL E6POS P,Q
P={kp(1500.0)}
Q=P
Q.X=Q.X+3
LIN P
LIN Q
SHIFT(P)
LIN P
END
""",
    must=("P={X 1500", "LIN Q"),
    never=("P={X 1500",),
)
krl(
    "inverse_and_forward",
    f"""DEF A()
LIN INV_POS({kp(1500.0)})
PTP INVERSE({kp(1500.0)},$AXIS_ACT,ERR)
LIN {kp(1500.0)}
$LOAD.M=30
$TOOL=$NULLFRAME
LIN {kp(1510.0)}
TOOL_DATA[3]={{X 0,Y 0,Z 100,A 0,B 0,C 0}}
BAS(#TOOL,3)
LIN {kp(1520.0)}
END
""",
    must=("INV_POS", "PTP INVERSE", "LIN {X 1500", "LIN {X 1510", "LIN {X 1520"),
)
krl(
    "interrupt",
    f"""DEF A()
INTERRUPT DECL 4 WHEN $IN[2]==TRUE DO CHG()
INTERRUPT ON 4
LIN {kp(1500.0)}
END
DEF CHG()
$BASE={{X 0,Y 0,Z 50,A 0,B 0,C 0}}
BRAKE F
RESUME
END
""",
    must=("LIN {X 1500",),
    never=("LIN {X 1500",),
)
krl(
    "ext_axis_and_while",
    """DEF A()
WHILE $IN[3]
LIN {X 1500.0,Y 200.0,Z 1200.0,A 0.0,B 90.0,C 0.0,E1 100.0}
SLIN {X 1510.0,Y 200.0,Z 1200.0,A 0.0,B 90.0,C 0.0,E1 100.0} WITH $ORI_TYPE=#CONSTANT C_SPL
SPTP_REL {A1 2}
SLIN_REL {Z 10}
LIN {Z 1300.0}
LIN {Z 1300.0,X 1500.0}
ENDWHILE
END
""",
    must=("LIN {X 1500", "SLIN {X", "LIN {Z 1300.0}", "LIN {Z 1300.0,X"),
)
krl(
    "no_space",
    f"""DEF A()
LIN{kp(1500.0)}
PTP{kp(1510.0)}C_PTP
CIRC{kp(1515.0, 210.0)},{kp(1520.0)},CA=180
LIN(P7)
END
""",
    must=("LIN{", "PTP{", "CIRC{", "LIN(P7)"),
)
rapid(
    "shadow_local",
    D
    + f"""PROC main()
MoveL p10,v100,fine,tool0;
sub;
ENDPROC
PROC sub()
VAR robtarget p10:={rp(1600)};
p10.trans.x:=p10.trans.x+1;
MoveL p10,v100,fine,tool0;
ENDPROC
""",
    must=("p10:=[[1500", "p10:=[[1600"),
)
rapid(
    "loc_tool_shadow",
    D
    + """PERS tooldata tx:=[TRUE,[[0,0,100],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];
PROC main()
VAR tooldata tx:=[TRUE,[[0,0,300],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];
MoveL p10,v100,fine,tx;
ENDPROC
PROC b()
MoveL p20,v100,fine,tx;
tx.tframe.trans.z:=200;
ENDPROC
""",
    must=("p10:=", "p20:="),
    never=("p10:=", "p20:="),
)
rapid(
    "trap_and_error",
    D
    + """PROC main()
CONNECT i1 WITH tr;
MoveL p10,v100,fine,tool0;
ERROR
RETRY;
UNDO MoveJ p20,v100,fine,tool0;
ENDPROC
TRAP tr
StorePath; MoveL pv,v100,fine,tool0; RestoPath;
ENDTRAP
""",
    must=("p10:=", "p20:=", "pv:="),
)
rapid(
    "func_returning",
    D
    + """FUNC robtarget up(robtarget p,num d)
RETURN Offs(p,0,0,d);
ENDFUNC
PROC main()
MoveL up(p10,50),v100,fine,tool0;
MoveL p10,v100,fine,tool0;
MoveJ\\Conc,p20,v100,z10,tool0\\WObj:=wobj0\\TLoad:=l1;
MoveL ReadBin(ch),v100,fine,tool0;
ENDPROC
""",
    must=("up(p10,50)", "p10:=", "p20:=", "ReadBin"),
)
rapid(
    "single_line_if",
    D
    + """PROC main()
IF a=1 THEN MoveL p10,v100,fine,tool0; ELSEIF a=2 THEN MoveL p20,v100,fine,tool0;
ELSE MoveL pv,v100,fine,tool0; ENDIF
GOTO l1; l1: MoveJ p10,v100,fine,tool0;
WHILE TRUE DO MoveJ p20,v100,fine,tool0; ENDWHILE
ENDPROC
""",
    must=("p10:=", "p20:=", "pv:="),
)
rapid(
    "record_component",
    """RECORD weld robtarget at; num f; ENDRECORD
CONST weld w1:=["""
    + rp(1500)
    + """,3];
CONST robtarget pj:="""
    + rp(1510)
    + """;
PROC main()
MoveL w1.at,v100,fine,tool0;
MoveL pj,v100,fine,tool0;
MoveL GetPoint("pj"),v100,fine,tool0;
GetDataVal "pj",pv;
SetDataVal "pj",pv;
ENDPROC
""",
    must=("w1:=", "MoveL GetPoint"),
    never=("pj:=",),
)
rapid(
    "task_frames",
    D
    + """PROC main()
SetSysData tool1;
EOffsOn;
MoveL p10,v100,fine,tool0;
EOffsOff;
PDispSet disp;
MoveL p20,v100,fine,tool0;
CorrCon id1; MoveL pv,v100,fine,tool0\\Corr; CorrDiscon id1;
ENDPROC
""",
    must=("p10:=", "p20:=", "pv:="),
    never=("p20:=",),
)
tp("twice_in_pos", ["L P[1] 100mm/sec FINE    ;"], fp(1) + fp(1, 1600.0), must=("L P[1]",))
tp(
    "frames_set_between",
    [
        "UTOOL_NUM=1    ;",
        "UFRAME_NUM=0    ;",
        "L P[1] 100mm/sec FINE    ;",
        "UFRAME[1]=PR[2]    ;",
        "UTOOL[1]=PR[3]    ;",
        "L P[2] 100mm/sec FINE    ;",
    ],
    fp(1) + fp(2, 1510.0),
    must=("P[1]{", "P[2]{"),
    never=("P[2]{",),
)
tp(
    "math_and_payload",
    [
        "PAYLOAD[2]    ;",
        "R[1]=P[1]    ;",
        "PR[1]=LPOS    ;",
        "PR[GP1:1,2]=5    ;",
        "L PR[1] 100mm/sec FINE    ;",
        "L P[1] 100mm/sec FINE PTH CR20    ;",
        "L P[2] max_speed FINE    ;",
        "J P[3] R[1]% CNT R[2] ACC100 EV50%    ;",
    ],
    "".join(fp(k, 1500 + k) for k in range(1, 4)),
    must=("P[1]{", "P[2]{", "P[3]{", "L PR[1]"),
)
tp(
    "select_and_for",
    [
        "FOR R[1]=1 TO 3    ;",
        "L P[R[1]] 100mm/sec FINE    ;",
        "ENDFOR    ;",
        "SELECT R[2]=1,CALL A1    ;",
        "       =2,JMP LBL[9]    ;",
        "IF R[1]>3 THEN    ;",
        "J P[2] 20% FINE    ;",
        "ENDIF    ;",
        "LBL[9:P[3]]    ;",
        "RUN B    ;",
    ],
    "".join(fp(k, 1500 + k) for k in range(1, 4)),
    must=("L P[R[1]]", "P[2]{"),
)
tp(
    "condition_monitor",
    [
        "MONITOR CH1    ;",
        "WHEN DI[1],CALL GOBACK    ;",
        "SKIP CONDITION DI[2]=ON    ;",
        "L P[1] 100mm/sec FINE Skip,LBL[1]    ;",
        "L P[2] 100mm/sec FINE DB 10.0mm,DO[1]=ON    ;",
        "COL GUARD ADJUST    ;",
        "L P[3] 5sec FINE    ;",
        "SOFTFLOAT[1]    ;",
        "L P[3] 12inch/min CNT50    ;",
    ],
    "".join(fp(k, 1500 + k) for k in range(1, 4)),
    must=("P[1]{", "P[2]{", "P[3]{"),
)
tp(
    "spaces_case",
    [
        "l p[1] 100mm/sec fine;",
        "L  P[ 2 ] 100mm/sec FINE;",
        "J P[2]   100%  CNT 50;",
        "CALL SUB(P[1],2)    ;",
    ],
    fp(1) + fp(2, 1510.0),
    must=("P[1]{", "P[2]{"),
)
ur(
    "shadow_local",
    f"""def a():
  global w={pp}
  def sub():
    local w=p[0.6,0.2,0.4,0.0,3.1416,0.0]
    w[0]=w[0]+0.01
    movel(w)
  end
  movel(w)
  sub()
end
""",
    must=("global w", "local w"),
)
ur(
    "conditional",
    f"""def a():
  if digital_in(1):
    w={pp}
  else:
    w=p[0.51,0.2,0.4,0.0,3.1416,0.0]
  end
  movel(w)
end
""",
    must=("w=p[0.5,", "w=p[0.51"),
)
ur(
    "alias_changed",
    f"""def a():
  w={pp}
  v=w
  v[0]=0.7
  movel(v)
  movel(w)
  w=pose_trans(w,p[0,0,0.1,0,0,0])
  movel(w)
end
""",
    must=("w=p[0.5", "movel(v)"),
    never=("w=p[0.5",),
)
ur(
    "named_args",
    f"""def a():
  movel(pose={pp},a=1.2,v=0.1)
  movej(q=[0,-1.57,1.57,-1.57,-1.57,0])
  movel(a=1.2,pose=p[0.51,0.2,0.4,0.0,3.1416,0.0])
  movec(pose_via={pp},pose_to=p[0.52,0.2,0.4,0.0,3.1416,0.0])
end
""",
    must=("movel(pose=", "movej(q=", "movel(a=1.2", "movec("),
)
ur(
    "single_line_blocks",
    f"""def a(): movel({pp}) end
thread t(): while True: movel(p[0.51,0.2,0.4,0.0,3.1416,0.0]) end end
a()
""",
    must=("def a()", "thread t()"),
)
ur(
    "set_tcp_in_thread",
    f"""def a():
  set_tcp(p[0,0,0.1,0,0,0])
  thread t():
    set_tcp(p[0,0,0.2,0,0,0])
  end
  run t()
  movel({pp})
end
""",
    must=("movel(",),
    never=("  movel(",),
)
ur(
    "string_hash",
    f"""def a():
  textmsg("# movel(", "x")
  popup("a \\" b movel(p[1,2,3,4,5,6])") movel({pp})
  movel(p[0.51,0.2,0.4,0.0,3.1416,0.0]) # movel(p[9,9,9,0,0,0])
end
""",
    must=("popup(", "movel(p[0.51"),
)
ur(
    "feature_and_conveyor",
    f"""def a():
  track_conveyor_linear(p[0.1,0,0,0,0,0],500)
  movel({pp})
  stop_conveyor_tracking()
  movel(p[0.51,0.2,0.4,0.0,3.1416,0.0])
  path_offset_enable()
  movel(p[0.52,0.2,0.4,0.0,3.1416,0.0])
end
""",
    must=("movel(p[0.5,", "movel(p[0.51", "movel(p[0.52"),
)


READERS = {"src": (of_kuka, K), "mod": (of_abb, R), "ls": (of_fanuc, T), "script": (of_ur, U)}
EVERY = [(end, name) for end, (_, own) in READERS.items() for name in own]
ITSELF = {
    ("ls", "offsets"): (" Offset,PR", "Tool_Offset", "FINE Offset  "),
    ("ls", "incremental_and_skip"): ("INC  ", "COORD", "RTCP"),
    ("ls", "weave_track_touch"): ("FINE VOFFSET", "Track TAST", "Touch Offset"),
    ("ls", "indirect"): ("P[R[1]]", "PR[3]", "PR[R[2]]"),
    ("mod", "other_motion_words"): ("ArcL", "MoveExtJ", "SpotML", "CSSDeactMoveL"),
    ("mod", "functions_of_targets"): ("Offs(", "RelTool(", "CRobT", "MirPos", "CalcJointT"),
    ("src", "geometric_operator"): (":{X 0,Y 0,Z 50", "$POS_ACT"),
    ("src", "asynchronous_and_trigger"): ("ASYPTP",),
    ("script", "servo_and_others"): ("speedl", "optimovel", "optimovej", "tool_contact_move"),
    ("script", "composed"): ("pose_trans", "pose_add"),
}
"""Motions that are listed by their own line: what is said of their point is not enough."""


def names(program):
    """Words by which a line may mean a point that is a target or listed."""
    found = [one.name for one in program.targets]
    found += [one.why.split(" ")[0].rstrip(":") for one in program.left]
    return {re.split(r"[^\w\[\]]", one)[0] for one in found if one and not one.startswith("the ")}


def goes_to(line, name, end):
    """Whether a line of a program speaks of a point."""
    if end == "ls":
        return name.rstrip("]") + "]" in line or name.rstrip("]") + ":" in line
    word = name.split("[")[0].split("{")[0]
    return bool(word) and re.search(rf"(?<!\w){re.escape(word)}(?!\w)", line) is not None


@pytest.mark.parametrize(("end", "name"), EVERY)
def test_no_motion_is_lost_and_no_unknown_point_is_moved(end, name):
    """The rule for every line that was marked by who wrote the program."""
    reader, own = READERS[end]
    body, must, never = own[name]
    program = reader.read(
        f"{name}.{end}", one_byte_characters(f"{name}.{end}", body.encode()), None
    )
    targets = {one.line for one in program.targets}
    listed = {one.line for one in program.left}
    known = names(program)

    for number, line in enumerate(body.split("\n"), 1):
        if any((first := one.split("\n")[0]) and first in line for one in must):
            there = number in targets | listed or any(goes_to(line, one, end) for one in known)
            assert there, f"line {number}: {line}"
        if any(one in line for one in never):
            assert number not in targets, f"line {number}: {line}"


@pytest.mark.parametrize(("end", "name"), ITSELF)
def test_a_motion_that_is_not_as_taught_is_listed_by_its_own_line(end, name):
    """An offset, a function or an unknown word moves the robot elsewhere than to the point."""
    reader, own = READERS[end]
    body, *_ = own[name]
    program = reader.read(
        f"{name}.{end}", one_byte_characters(f"{name}.{end}", body.encode()), None
    )
    listed = {one.line for one in program.left}

    for word in ITSELF[end, name]:
        lines = [k for k, line in enumerate(body.split("\n"), 1) if word in line]
        assert lines
        assert set(lines) <= listed, word


def test_every_language_has_more_than_ten():
    """Ten were asked for."""
    assert all(len(own) > 10 for _, own in READERS.values())
    assert programs.is_program("a.src")
