"""Robots small enough that their motion has a closed form."""

from flywheel.robots import Robot, read_robot

MASS, STIFFNESS, HEIGHT, REST = 2.0, 500.0, 3.0, 1.0

WINCH = """
  <general name="winch" tendon="cable" dyntype="integrator" ctrllimited="true" ctrlrange="-1 1"
    actlimited="true" actrange="0.2 2.5" gainprm="{k}" biastype="affine" biasprm="0 -{k} -{c}"
    forcelimited="true" forcerange="-1e4 0"/>
"""

HANGING = """
<mujoco model="hanging">
  <option timestep="0.001" integrator="implicitfast"/>
  <default> <geom friction="0.5" condim="3" solref="-5000 -100"/> </default>
  <worldbody>
    <geom type="plane" size="9 9 .1"/>
    <site name="anchor" pos="0 0 {height}"/>
    <body name="bob" pos="0 0 {z}">
      <freejoint/>
      <geom name="bob" type="{shape}" size="0.1 0.1 0.1" mass="{mass}"/>
      <site name="bob"/>
    </body>
  </worldbody>
  <tendon>
    <spatial name="cable"> <site site="anchor"/> <site site="bob"/> </spatial>
    {tendon}
  </tendon>
  <actuator> {winch} {actuator} </actuator>
  <sensor> <framepos name="bob" objtype="site" objname="bob"/> </sensor>
  <keyframe> <key qpos="0 0 {z} 1 0 0 0" act="{rest}"/> </keyframe>
</mujoco>
"""


def hanging(
    z: float = HEIGHT - REST,
    rest: float = REST,
    damping: float = 0.0,
    shape: str = "sphere",
    tendon: str = "",
    actuator: str = "",
) -> Robot:
    """A mass on one winched cable from (0, 0, HEIGHT), at height z, above a ground."""
    winch = WINCH.format(k=STIFFNESS, c=damping)
    xml = HANGING.format(
        height=HEIGHT,
        z=z,
        mass=MASS,
        rest=rest,
        shape=shape,
        winch=winch,
        tendon=tendon,
        actuator=actuator,
    )
    return read_robot(xml)
