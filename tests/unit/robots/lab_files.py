"""MJCFs as laboratories write them for their own work: none can be used as it is.

Each function writes one kind into a folder and returns its path; geometry and words are made up here.
"""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

FLOOR = '<geom name="floor" type="plane" size="0 0 .05"/>'
CUBE = """v -1 -1 -1
v 1 -1 -1
v 1 1 -1
v -1 1 -1
v -1 -1 1
v 1 -1 1
v 1 1 1
v -1 1 1
f 1 3 2
f 1 4 3
f 5 6 7
f 5 7 8
f 1 2 6
f 1 6 5
f 2 3 7
f 2 7 6
f 3 4 8
f 3 8 7
f 4 1 5
f 4 5 8
"""


def written(folder: Path, text: str, name: str = "robot.xml") -> Path:
    (folder / name).write_text(text)
    return folder / name


def tendons(pairs: Iterable[tuple[str, str]], attributes: str, named: bool = True) -> str:
    text = ""
    for a, b in pairs:
        name = f'name="{a}-{b}" ' if named else ""
        text += f'<spatial {name}{attributes}><site site="{a}"/><site site="{b}"/></spatial>'
    return text


def rods(count: int = 3, radius: float = 0.25, height: float = 0.5, twist: float = 150.0) -> str:
    """Slanted capsules on free joints, with a site at each end: b0 (below) and t0 (above), b1, ..."""
    bodies = ""
    for i in range(count):
        low, high = np.deg2rad(360.0 * i / count), np.deg2rad(360.0 * i / count + twist)
        a = np.array([radius * np.cos(low), radius * np.sin(low), 0.05])
        b = np.array([radius * np.cos(high), radius * np.sin(high), height])
        middle = (a + b) / 2
        ends = " ".join(f"{value:.6f}" for value in (*(a - middle), *(b - middle)))
        low_end, high_end = ends.split()[:3], ends.split()[3:]
        bodies += f"""
      <body name="rod{i}" pos="{middle[0]:.6f} {middle[1]:.6f} {middle[2]:.6f}">
        <freejoint/>
        <geom type="capsule" fromto="{ends}" size=".02" mass=".4"/>
        <site name="b{i}" pos="{" ".join(low_end)}"/> <site name="t{i}" pos="{" ".join(high_end)}"/>
      </body>"""
    return bodies


def sides(count: int = 3) -> list[tuple[str, str]]:
    return [(f"b{i}", f"t{(i + 1) % count}") for i in range(count)]


def rings(count: int = 3) -> list[tuple[str, str]]:
    return [(f"{end}{i}", f"{end}{(i + 1) % count}") for end in "bt" for i in range(count)]


def prism_driven_from_python(folder: Path) -> Path:
    """Springs that push, without names, names of MuJoCo 2; a script edits their rest lengths."""
    return written(
        folder,
        f"""<mujoco>
  <option timestep=".002"><flag sensornoise="enable"/></option>
  <size njmax="500" nconmax="100"/>
  <worldbody>{FLOOR}{rods()}</worldbody>
  <tendon>{tendons(rings(), 'stiffness="300" damping="4" springlength=".3"', named=False)}
  {tendons(sides(), 'stiffness="400" damping="4" springlength=".3"')}</tendon>
</mujoco>""",
    )


def prism_with_filtered_servos(folder: Path) -> Path:
    """Servos with MuJoCo's older lag, an offset, another gain, in nested classes."""
    pairs = sides()
    servos = "".join(
        f'<general class="slow" name="m{i}" tendon="{a}-{b}"/>' for i, (a, b) in enumerate(pairs)
    )
    return written(
        folder,
        f"""<mujoco model="servo prism">
  <option timestep=".002" integrator="implicitfast"/>
  <default>
    <tendon damping="2"/>
    <default class="servo">
      <general biastype="affine" gainprm="200" biasprm="25 -250 -3" ctrllimited="true" ctrlrange=".1 .7"/>
      <default class="slow"><general dyntype="filter" dynprm=".05"/></default>
    </default>
  </default>
  <worldbody>{FLOOR}{rods()}</worldbody>
  <tendon>{tendons(rings(), 'stiffness="300" springlength="0 .3"')}{tendons(pairs, "")}</tendon>
  <actuator>{servos}</actuator>
</mujoco>""",
    )


def platform(
    anchors: int, tendon: str = "", body: str = "", height: float = 1.0
) -> tuple[str, str]:
    """World and tendons of a box on cables from posts 2 m high: names p0-c0, p1-c1, ..."""
    angles = np.pi / 4 + np.arange(anchors) * 2 * np.pi / anchors
    posts = "".join(
        f'<site name="p{i}" pos="{1.5 * np.cos(a):.6f} {1.5 * np.sin(a):.6f} 2"/>'
        for i, a in enumerate(angles)
    )
    corners = "".join(
        f'<site name="c{i}" pos="{0.2 * np.cos(a):.6f} {0.2 * np.sin(a):.6f} .03"/>'
        for i, a in enumerate(angles)
    )
    world = f"""{posts}<body name="plate" pos="0 0 {height}"><freejoint/>
      {body or '<geom name="plate" type="box" size=".15 .15 .03" mass="3"/>'}{corners}</body>"""
    return world, tendons([(f"p{i}", f"c{i}") for i in range(anchors)], tendon)


def platform_with_drums(folder: Path) -> Path:
    """Position servos through drums: gear .02, commands in other units, and no keyframe."""
    world, cables = platform(4)
    servos = "".join(
        f'<position name="drum{i}" tendon="p{i}-c{i}" kp="9e6" kv="2e4" gear=".02"/>'
        for i in range(4)
    )
    return written(
        folder,
        f"""<mujoco model="drums"><option timestep=".002" integrator="implicitfast"/>
  <worldbody>{world}</worldbody><tendon>{cables}</tendon><actuator>{servos}</actuator></mujoco>""",
    )


def platform_without_ranges(folder: Path) -> Path:
    """Eight winches of rates whose ranges only a class has, and which it switches off."""
    world, cables = platform(8)
    winches = "".join(f'<general class="winch" name="w{i}" tendon="p{i}-c{i}"/>' for i in range(8))
    return written(
        folder,
        f"""<mujoco model="eight">
  <compiler autolimits="false"/><option timestep=".002" integrator="implicitfast"/>
  <default><default class="winch">
    <general dyntype="integrator" biastype="affine" gainprm="8000" biasprm="0 -8000 -90" ctrlrange="-.3 .3"/>
  </default></default>
  <worldbody>{world}</worldbody><tendon>{cables}</tendon><actuator>{winches}</actuator>
  <sensor>
    <framepos name="pose" objtype="body" objname="plate"/><framequat objtype="body" objname="plate"/>
  </sensor>
</mujoco>""",
    )


def platform_of_stiff_and_damping_servos(folder: Path) -> Path:
    """A <position> and a <velocity> on each cable, and a keyframe."""
    world, cables = platform(4)
    both = "".join(
        f'<position name="kp{i}" tendon="p{i}-c{i}" kp="5000" ctrlrange="0 2.5" ctrllimited="true"/>'
        f'<velocity name="kv{i}" tendon="p{i}-c{i}" kv="60"/>'
        for i in range(4)
    )
    commands = " ".join(["1.62 0"] * 4)
    return written(
        folder,
        f"""<mujoco model="kp and kv"><option timestep=".002" integrator="implicitfast"/>
  <worldbody>{world}</worldbody><tendon>{cables}</tendon><actuator>{both}</actuator>
  <keyframe><key name="home" qpos="0 0 1 1 0 0 0" ctrl="{commands}"/></keyframe></mujoco>""",
    )


def prism_with_springs_beside_servos(folder: Path) -> Path:
    """A spring and a position servo on the same tendon."""
    pairs = sides()
    servos = "".join(
        f'<position name="m{i}" tendon="{a}-{b}" kp="400" kv="3" timeconst=".04" ctrlrange=".1 .6" '
        'forcerange="-80 0"/>'
        for i, (a, b) in enumerate(pairs)
    )
    return written(
        folder,
        f"""<mujoco model="beside"><option timestep=".002" integrator="implicitfast"/>
  <worldbody>{FLOOR}{rods()}</worldbody>
  <tendon>{tendons(rings(), 'stiffness="300" damping="2" springlength=".3"')}
  {tendons(pairs, 'stiffness="90" damping="1" springlength=".3"')}</tendon>
  <actuator>{servos}</actuator></mujoco>""",
    )


def y_up(folder: Path) -> Path:
    """The world lies on its side, with a keyframe."""
    path = prism_with_springs_beside_servos(folder)
    world = '<worldbody><frame euler="-90 0 0">'
    edits = {
        "<option ": '<option gravity="0 -9.81 0" wind="0 0 .2" density="1.2" ',
        "<worldbody>": world,
        "</worldbody>": "</frame></worldbody>",
    }
    text = path.read_text()
    for old, new in edits.items():
        text = text.replace(old, new)
    return written(folder, text)


def six_rods_with_tension_motors(folder: Path) -> Path:
    """Springs that push, each with a motor of a tension and a lag on the same tendon."""
    pairs = [*rings(6), *sides(6)]
    motors = "".join(f'<general class="pull" name="{a}{b}" tendon="{a}-{b}"/>' for a, b in pairs)
    return written(
        folder,
        f"""<mujoco model="tensions"><option timestep=".002" collision="all" integrator="implicitfast"/>
  <default>
    <tendon stiffness="200" damping="5"/>
    <default class="pull">
      <general ctrllimited="true" ctrlrange="-9 0" dyntype="filter" dynprm=".02"/>
    </default>
  </default>
  <worldbody>{FLOOR}{rods(6)}</worldbody>
  <tendon>{tendons(pairs, "")}</tendon>
  <actuator>{motors}</actuator></mujoco>""",
    )


def rods_with_weak_servos(folder: Path) -> Path:
    """Springs, and position servos that are told lengths below 0, so that they pull all the time."""
    pairs = sides()
    servos = "".join(
        f'<position name="m{i}" tendon="{a}-{b}" kp="3" ctrlrange="-6 0" gear="2"/>'
        for i, (a, b) in enumerate(pairs)
    )
    return written(
        folder,
        f"""<mujoco model="weak"><option timestep=".002" integrator="implicitfast"/>
  <worldbody>{FLOOR}{rods()}</worldbody>
  <tendon>{tendons([*rings(), *pairs], 'stiffness="150" damping="2"')}</tendon>
  <actuator>{servos}</actuator></mujoco>""",
    )


def platform_in_several_files(folder: Path) -> Path:
    """Includes, a texture, and a mesh that is only looked at and gives the mass."""
    (folder / "shapes").mkdir(exist_ok=True)
    (folder / "shapes" / "cube.obj").write_text(CUBE)
    body = '<geom type="mesh" mesh="cube" class="looks"/>'
    world, cables = platform(4, body=body)
    written(
        folder,
        """<mujocoinclude><asset>
      <texture name="wood" type="2d" file="wood.png"/><material name="wood" texture="wood"/>
      <mesh name="cube" file="cube.obj" scale=".15 .12 .03"/>
    </asset></mujocoinclude>""",
        "looks.xml",
    )
    winches = "".join(
        f'<general tendon="p{i}-c{i}" dyntype="integrator" gainprm="9000" biastype="affine" '
        'biasprm="0 -9000 -90" ctrlrange="-.4 .4" actrange=".3 3" forcerange="-400 0"/>'
        for i in range(4)
    )
    written(folder, f"<mujoco><actuator>{winches}</actuator></mujoco>", "winches.xml")
    return written(
        folder,
        f"""<mujoco><compiler meshdir="shapes"/><option timestep=".002" integrator="implicitfast"/>
  <include file="looks.xml"/>
  <default><default class="looks">
    <geom contype="0" conaffinity="0" density="700" material="wood"/>
  </default></default>
  <worldbody><!-- posts of aluminium -->{world}</worldbody><tendon>{cables}</tendon>
  <include file="winches.xml"/></mujoco>""",
    )


def old_paper(folder: Path) -> Path:
    """Global coordinates, contacts by pairs, and springs, in words of MuJoCo 2."""
    bodies = ""
    for i, y in enumerate((-0.3, 0.0, 0.3)):
        bodies += f"""<body name="strut{i}"><joint type="free"/>
          <geom name="strut{i}" type="cylinder" fromto="-.4 {y} .5 .4 {y} .5" size=".02" mass=".3"/>
          <geom name="left{i}" type="sphere" pos="-.4 {y} .5" size=".04" mass=".1"/>
          <geom name="right{i}" type="sphere" pos=".4 {y} .5" size=".04" mass=".1"/>
          <site name="l{i}" pos="-.4 {y} .5"/><site name="r{i}" pos=".4 {y} .5"/></body>"""
    pairs = [("l0", "l1"), ("l1", "l2"), ("r0", "r1"), ("r1", "r2"), ("l0", "r1"), ("l1", "r2")]
    contacts = "".join(
        f'<pair geom1="floor" geom2="{end}{i}"/>' for i in range(3) for end in ("left", "right")
    )
    return written(
        folder,
        f"""<mujoco model="struts"><compiler coordinate="global"/>
  <option timestep=".002" collision="predefined" mpr_iterations="30"/>
  <worldbody>{FLOOR}{bodies}</worldbody><contact>{contacts}</contact>
  <tendon>{tendons(pairs, 'stiffness="200" damping="5"')}</tendon></mujoco>""",
    )


def integrated_velocity(folder: Path) -> Path:
    """<intvelocity> winches whose forces may push, with an unnamed body and sensor."""
    world, cables = platform(4)
    winches = "".join(
        f'<intvelocity name="w{i}" tendon="p{i}-c{i}" kp="7000" kv="80" actrange=".3 3" '
        'ctrlrange="-.2 .2" forcerange="-900 900"/>'
        for i in range(4)
    )
    return written(
        folder,
        f"""<mujoco model="velocities"><option timestep=".002" integrator="implicitfast"/>
  <worldbody>{FLOOR}{world.replace('body name="plate"', "body")}</worldbody><tendon>{cables}</tendon>
  <actuator>{winches}</actuator><sensor><framepos objtype="site" objname="c0"/></sensor></mujoco>""",
    )


def speed_servos(folder: Path) -> Path:
    """<velocity> servos, whose commands are speeds, and which have no stiffness."""
    world, cables = platform(4)
    servos = "".join(f'<velocity name="v{i}" tendon="p{i}-c{i}" kv="60"/>' for i in range(4))
    return written(
        folder,
        f"""<mujoco model="speeds"><option timestep=".002" integrator="implicitfast"/>
  <worldbody>{world}</worldbody><tendon>{cables}</tendon><actuator>{servos}</actuator></mujoco>""",
    )


def activations_in_the_key(folder: Path) -> Path:
    """Servos without a lag, beside a keyframe that gives them activations."""
    world, cables = platform(4)
    servos = "".join(
        f'<position name="s{i}" tendon="p{i}-c{i}" kp="6000" kv="70" ctrlrange=".4 2.4"/>'
        for i in range(4)
    )
    return written(
        folder,
        f"""<mujoco model="key"><option timestep=".002" integrator="implicitfast"/>
  <worldbody>{world}</worldbody><tendon>{cables}</tendon><actuator>{servos}</actuator>
  <keyframe><key name="home" qpos="0 0 1 1 0 0 0" act="1.6 1.6 1.6 1.6" ctrl="1.6 1.6 1.6 1.6"/></keyframe>
</mujoco>""",
    )


def crossed_bars(folder: Path) -> Path:
    """Two bars, four springs with reference lengths from the geometry, driven from Python."""
    pairs = [("a0", "b0"), ("a1", "b1"), ("a0", "b1"), ("a1", "b0")]
    return written(
        folder,
        f"""<mujoco model="cross"><option timestep=".002"/>
  <worldbody>{FLOOR}
    <body name="a" pos="0 .03 .3" euler="0 45 0"><freejoint/>
      <geom type="cylinder" size=".02 .3" mass=".5"/>
      <site name="a0" pos="0 0 -.3"/><site name="a1" pos="0 0 .3"/>
    </body>
    <body name="b" pos="0 -.03 .3" euler="0 -45 0"><freejoint/>
      <geom type="cylinder" size=".02 .3" mass=".5"/>
      <site name="b0" pos="0 0 -.3"/><site name="b1" pos="0 0 .3"/>
    </body>
  </worldbody>
  <tendon>{tendons(pairs, 'stiffness="500" damping="9"')}</tendon>
</mujoco>""",
    )


def ropes(folder: Path) -> Path:
    """Ropes of a greatest length, and nothing that winds them."""
    world, cables = platform(4, tendon='limited="true" range="0 1.7"')
    return written(
        folder,
        f'<mujoco model="ropes"><worldbody>{world}</worldbody><tendon>{cables}</tendon></mujoco>',
    )


def weights_in_a_row(folder: Path) -> Path:
    """Weights with two springs each and a motor, all copied, a clock, and a keyframe; they may sleep."""
    return written(
        folder,
        f"""<mujoco model="row"><compiler angle="radian" eulerseq="zyx"/><option timestep=".002"/>
  <worldbody>{FLOOR}<site name="rail" pos="0 0 2"/>
    <replicate count="3" offset=".5 0 .1" euler=".3 .2 .1" sep="-">
      <site name="hook" pos="0 0 1.6"/>
      <body name="weight" pos="0 0 1" sleep="allowed"><freejoint/><geom size=".05" mass="1"/>
        <site name="top"/>
        <replicate count="2" offset="0 .1 0"><site name="ring" pos="0 -.05 0"/></replicate></body>
    </replicate>
    <body name="other" pos="-1 0 1"><freejoint/><geom size=".05" mass="1"/><site name="eye"/></body>
  </worldbody>
  <default><default class="soft"><tendon stiffness="90" damping="3" springlength="0 .9"/></default></default>
  <tendon>
    <spatial name="spring" class="soft"><site site="rail"/><site site="ring"/></spatial>
    <spatial name="own" class="soft"><site site="rail"/><site site="eye"/></spatial>
    <spatial name="pulled"><site site="hook"/><site site="top"/></spatial>
  </tendon>
  <actuator><position name="motor" tendon="pulled" kp="90" kv="3" ctrlrange=".5 2"/></actuator>
  <sensor><clock name="clock"/><framepos name="seen" objtype="site" objname="eye"/></sensor></mujoco>""",
    )


def hinged_leg(folder: Path) -> Path:
    """A leg with a knee and meshes whose files are elsewhere."""
    return written(
        folder,
        """<mujoco model="leg"><asset><mesh name="shin" file="shin.stl"/></asset>
  <worldbody><body name="thigh" pos="0 0 1"><joint name="hip" axis="0 1 0"/><geom type="mesh" mesh="shin"/>
    <site name="a"/><body name="shin" pos="0 0 -.4"><joint name="knee" axis="0 1 0"/>
    <geom type="mesh" mesh="shin"/><site name="b"/></body></body></worldbody>
  <tendon><spatial name="rope"><site site="a"/><site site="b"/></spatial></tendon></mujoco>""",
    )


def routed_trunk(folder: Path) -> Path:
    """Discs whose cables pass through holes of all of them."""
    discs = "".join(
        f'<body name="disc{i}" pos="0 0 {0.1 * i + 0.1}"><freejoint/>'
        f'<geom type="cylinder" size=".05 .005" mass=".1"/><site name="hole{i}" pos=".04 0 0"/></body>'
        for i in range(3)
    )
    path = "".join(f'<site site="hole{i}"/>' for i in range(3))
    return written(
        folder,
        f"""<mujoco model="trunk"><worldbody><site name="base" pos=".04 0 0"/>{discs}</worldbody>
  <tendon><spatial name="tendon_1" stiffness="50"><site site="base"/>{path}</spatial></tendon>
  <actuator><motor name="pull" tendon="tendon_1" ctrlrange="-10 0"/></actuator></mujoco>""",
    )


def muscles(folder: Path) -> Path:
    world, cables = platform(4)
    pulls = "".join(f'<muscle name="m{i}" tendon="p{i}-c{i}"/>' for i in range(4))
    return written(
        folder,
        f"""<mujoco model="muscular"><worldbody>{world}</worldbody><tendon>{cables}</tendon>
  <actuator>{pulls}</actuator></mujoco>""",
    )


def tension_motors(folder: Path) -> Path:
    world, cables = platform(4)
    pulls = "".join(f'<motor name="m{i}" tendon="p{i}-c{i}" ctrlrange="-50 0"/>' for i in range(4))
    return written(
        folder,
        f"""<mujoco model="motors"><worldbody>{world}</worldbody><tendon>{cables}</tendon>
  <actuator>{pulls}</actuator></mujoco>""",
    )


def two_motors_on_a_spring(folder: Path) -> Path:
    """The second motor has the first one's tendon, by mistake."""
    path = six_rods_with_tension_motors(folder)
    return written(
        folder, path.read_text().replace('name="b1b2" tendon="b1-b2"', 'name="b1b2" tendon="b0-b1"')
    )


def on_a_slope(folder: Path) -> Path:
    """Gravity that stands for a slope."""
    path = prism_with_springs_beside_servos(folder)
    return written(folder, path.read_text().replace("<option ", '<option gravity="-2 0 -9.6" '))


ADAPTABLE = (
    prism_driven_from_python,
    prism_with_filtered_servos,
    platform_with_drums,
    platform_without_ranges,
    platform_of_stiff_and_damping_servos,
    prism_with_springs_beside_servos,
    y_up,
    six_rods_with_tension_motors,
    rods_with_weak_servos,
    platform_in_several_files,
    old_paper,
    integrated_velocity,
    activations_in_the_key,
    crossed_bars,
    ropes,
    tension_motors,
    weights_in_a_row,
)
DRIVEN_FROM_PYTHON = {
    "prism_driven_from_python": ("b?-t?",),
    "old_paper": ("l?-r?",),
    "crossed_bars": ("a*",),
    "ropes": ("p*",),
}
REFUSED = {
    hinged_leg: "It has the joints 'hip' (hinge, of the body 'thigh'), 'knee' (hinge, of the body 'shin')",
    routed_trunk: "The tendon 'tendon_1' must be straight between exactly two sites",
    muscles: "The MJCF has a muscle",
    two_motors_on_a_spring: "The actuators 'b0b1', 'b1b2' must have a stiffness k",
    speed_servos: "The actuators 'v0', 'v1', 'v2', 'v3' must have a stiffness, which a <velocity> lacks",
    on_a_slope: "The MJCF has gravity along a slanting line",
}
