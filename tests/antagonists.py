"""A robot with two cables on one motor: one reels in what the other pays out."""

from flywheel.robots import Robot, read_robot

RATE = 'dyntype="integrator" ctrllimited="true" ctrlrange="-0.1 0.1"'
POSITION = 'dyntype="filterexact" dynprm="0.05"'
SPRING = (
    'gainprm="900" biastype="affine" biasprm="0 -900 -9" forcelimited="true" forcerange="-300 0"'
)
ANCHORS = [
    ("left", -2, 1),
    ("right", 2, 1),
    ("top", 0, 2.5),
    ("front", 0.3, -0.5),
    ("back", -0.3, -0.5),
]


def antagonists(dynamics: str = RATE, limit: str = "act") -> Robot:
    """A box between a left and a right cable on one drum, held by three stays."""
    sites = "".join(f'<site name="{name}" pos="{x} 0 {z}"/>' for name, x, z in ANCHORS)
    stays = "".join(
        f'<spatial name="{name}_stay" stiffness="200" damping="9" springlength="0 {rest}">'
        f'<site site="{name}"/><site site="{end}"/></spatial>'
        for name, end, rest in (("top", "up", 1.2), ("front", "e", 1.3), ("back", "w", 1.3))
    )
    return read_robot(f"""<mujoco model="pair"><option timestep="0.005" integrator="implicitfast"/>
  <worldbody>{sites}
    <body name="box" pos="0 0 1"><freejoint/>
      <geom type="box" size=".2 .1 .1" mass="3"/>
      <site name="w" pos="-.2 0 0"/><site name="e" pos=".2 0 0"/><site name="up" pos="0 .1 .1"/>
    </body>
  </worldbody>
  <tendon>{stays}
    <spatial name="l"><site site="left"/><site site="w"/></spatial>
    <spatial name="r"><site site="right"/><site site="e"/></spatial>
  </tendon>
  <actuator>
    <general name="in" tendon="l" {dynamics} {limit}limited="true" {limit}range="1.4 2" {SPRING}/>
    <general name="out" tendon="r" {dynamics} {limit}limited="true" {limit}range="1.3 1.9" {SPRING}/>
  </actuator>
  <custom><tuple name="pair">
    <element objtype="actuator" objname="in"/><element objtype="actuator" objname="out" prm="-1"/>
  </tuple></custom>
  <sensor>
    <framepos name="m0" objtype="site" objname="w"/><framepos name="m1" objtype="site" objname="e"/>
    <framepos name="m2" objtype="site" objname="up"/>
  </sensor>
  <keyframe><key qpos="0 0 1 1 0 0 0" act="1.7 1.6"/></keyframe>
</mujoco>""")
