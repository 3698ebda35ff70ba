"""A robot and an object on a floor, as a MuJoCo model.

Every scene of a robot has the same sizes whatever its object, since each reserves SLOTS boxes: so any objects can
share one batch.
"""

import mujoco
import numpy as np
from scipy.spatial import ConvexHull, QhullError

from mimicbench.core.errors import BadObject, UnknownName
from mimicbench.objects.shape import SLOTS, SceneObject
from mimicbench.robots.description import Robot, Shape
from mimicbench.sim.timing import PHYSICS_DT

FRICTION = (1.0, 0.005, 0.0001)
"""Sliding, torsional and rolling friction of everything."""
ROBOT_GROUP, OBJECT_GROUP, FLOOR_GROUP, VISUAL_GROUP = 3, 1, 0, 2
"""Geom groups: rays that look at the scene leave out the robot's own."""
OBJECT_BODY = "object"
MESH_NODES = SLOTS * (2 * 44 - 1) + 14
"""Nodes of the bounding-volume trees over all meshes of a scene that has any: SLOTS pieces of 24 corners, which have 44
faces, and what `_add_ballast` adds."""
_WORLD_BIT = 1
_GRAY = (0.6, 0.62, 0.65, 1.0)


def build_model(
    robot: Robot,
    obj: SceneObject,
    preset: str = "improved",
    control: str = "position",
    visuals: bool = False,
    meshes: bool | None = None,
    friction: float = 1.0,
    mass: float = 1.0,
) -> mujoco.MjModel:
    """Compile the scene of one robot and one object; see `describe_scene`."""
    return describe_scene(robot, obj, preset, control, visuals, meshes, friction, mass).compile()


def describe_scene(
    robot: Robot,
    obj: SceneObject,
    preset: str = "improved",
    control: str = "position",
    visuals: bool = False,
    meshes: bool | None = None,
    friction: float = 1.0,
    mass: float = 1.0,
) -> mujoco.MjSpec:
    """The scene of one robot and one object, to be compiled. Raises UnknownName.

    Args:
        robot: its links are the first bodies.
        obj: at the origin facing +x; it moves if it is movable.
        preset: which of the robot's gains to use.
        control: `position` (PD towards joint angles), `velocity` (damping towards joint velocities) or `torque`.
        visuals: add what is only there for pictures: shells, floor pattern, lights. The state stays the same.
        meshes: make room for an object's convex pieces, so that the scene can share a batch with scenes of imported
            objects; None: only if this object has any.
        friction: times the sliding friction that everything has.
        mass: times the mass and inertia that the robot's links have.
    """
    if preset not in robot.gains:
        raise UnknownName("gains", preset, list(robot.gains))
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.timestep = PHYSICS_DT
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    _add_floor(spec, visuals)
    _add_robot(spec, robot, visuals)  # first, so that its coordinates come first whether or not the object moves
    _add_object(spec, obj, bool(obj.hulls) if meshes is None else meshes or bool(obj.hulls))
    _add_actuators(spec, robot, preset, control)
    if friction != 1.0:
        for geom in spec.geoms:
            geom.friction[0] *= friction
    if mass != 1.0:
        for link in robot.link_names:
            body = spec.body(link)
            body.mass, body.fullinertia = body.mass * mass, body.fullinertia * mass
    return spec


def build_object(obj: SceneObject) -> mujoco.MjModel:
    """Compile an object alone: its body, joint and slots as in `build_model`, in a tenth of the time."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    _add_object(spec, obj, False)
    return spec.compile()


def _add_floor(spec: mujoco.MjSpec, visuals: bool) -> None:
    plane = mujoco.mjtGeom.mjGEOM_PLANE
    floor = spec.worldbody.add_geom(name="floor", type=plane, size=[0, 0, 0.05], group=FLOOR_GROUP)
    floor.contype = floor.conaffinity = _WORLD_BIT
    floor.friction = FRICTION
    if not visuals:
        return
    spec.visual.headlight.ambient = [0.35, 0.35, 0.37]
    spec.visual.headlight.diffuse = [0.35, 0.35, 0.35]
    spec.visual.quality.shadowsize = 4096
    spec.add_texture(
        name="floor",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        width=512,
        height=512,
        rgb1=[0.80, 0.78, 0.75],
        rgb2=[0.77, 0.75, 0.72],
    )
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        width=256,
        height=256,
        rgb1=[0.93, 0.94, 0.96],
        rgb2=[0.80, 0.84, 0.90],
    )
    material = spec.add_material(name="floor", texrepeat=[2, 2], texuniform=True, reflectance=0.03)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "floor"
    floor.material = "floor"
    spec.worldbody.add_light(pos=[1.5, -1.5, 4.0], dir=[-0.3, 0.35, -1.0], diffuse=[0.65, 0.64, 0.62], castshadow=True)


def _add_object(spec: mujoco.MjSpec, obj: SceneObject, meshes: bool) -> None:
    body = spec.worldbody.add_body(name=OBJECT_BODY)
    hulls = [None if _is_box(hull) else hull for hull in obj.hulls] or [None] * len(obj.box_pos)
    if obj.movable:
        body.add_freejoint()
        # pieces share the mass by volume
        volume = np.array(
            [
                8 * half.prod() if hull is None else _hull(obj, hull).volume
                for half, hull in zip(obj.box_half, hulls, strict=True)
            ]
        )
        masses = (obj.mass or 1.0) * volume / volume.sum()
    else:
        masses = np.zeros(len(obj.box_pos))
    for slot in range(SLOTS):
        geom = body.add_geom(name=f"object_{slot}", type=mujoco.mjtGeom.mjGEOM_BOX, group=OBJECT_GROUP)
        geom.friction = (obj.friction, *FRICTION[1:])
        # or MuJoCo would take the larger friction of the two that touch, and nothing could be slippery
        geom.priority = 1
        # every slot takes part in collision, for MuJoCo lays out its memory by the number that does; a slot to spare
        # is a grain in the middle of the first box or convex piece, where nothing touches it
        used, spare = min(slot, len(obj.box_pos)) % len(obj.box_pos), slot >= len(obj.box_pos)
        geom.pos, geom.quat, geom.size = (
            obj.box_pos[used],
            obj.box_quat[used],
            np.full(3, 0.001) if spare else obj.box_half[used],
        )
        geom.rgba = [*obj.box_rgb[used], 1.0]
        geom.contype = geom.conaffinity = _WORLD_BIT
        geom.mass = 0.0 if spare else masses[slot]
        if spare and hulls[0] is not None:  # in the middle of the box around a piece there may be air
            geom.pos = hulls[0].mean(0)
        hull = None if spare else hulls[slot]
        if hull is not None:
            _add_mesh(spec, f"object_{slot}", hull, _hull(obj, hull).simplices)
            geom.type, geom.meshname, geom.size = mujoco.mjtGeom.mjGEOM_MESH, f"object_{slot}", np.zeros(3)
            geom.pos, geom.quat = np.zeros(3), (1, 0, 0, 0)  # corners are in the object's frame
    if meshes:
        _add_ballast(spec, obj)


def _is_box(hull: np.ndarray) -> bool:
    """Whether a convex piece has eight corners that are those of a box, which is quicker and steadier as such."""
    if len(hull) != 8:
        return False
    away = np.linalg.norm(hull - hull.mean(0), axis=1)
    opposite = (np.linalg.norm(hull[:, None] + hull[None] - 2 * hull.mean(0), axis=-1) < 1e-7).sum()
    return bool(np.ptp(away) < 1e-7 and opposite == 8)


def _hull(obj: SceneObject, corners: np.ndarray) -> ConvexHull:
    try:
        return ConvexHull(corners)
    except (QhullError, ValueError):
        raise BadObject(f"object {obj.id} has a convex piece without volume; import it again") from None


def _add_mesh(spec: mujoco.MjSpec, name: str, corners: np.ndarray, faces: np.ndarray) -> None:
    a, b, c = (corners[faces[:, i]] for i in range(3))
    inward = (np.cross(b - a, c - a) * (a - corners.mean(0))).sum(1) < 0
    faces = np.where(inward[:, None], faces[:, ::-1], faces)
    spec.add_mesh(
        name=name,
        uservert=corners.ravel(),
        userface=faces.ravel().astype(np.int32),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX,
    )


def _add_ballast(spec: mujoco.MjSpec, obj: SceneObject) -> None:
    """A mesh that no geom uses, so that all scenes with meshes have bounding-volume trees of one size and can share
    a batch.

    A batch takes models of boxes and of meshes, and of meshes of any size, as long as MjData's layout is the same; of a
    mesh, MjData holds a mark per node of its tree, and a tree over F faces has 2 F - 1 nodes.
    """
    used = [len(mesh.userface) // 3 for mesh in spec.meshes]
    left = MESH_NODES - sum(2 * faces - 1 for faces in used)
    if left % 2 == 0:  # a tree of an even size is two odd ones
        _add_tetrahedra(spec, "ballast_0", 4)
        left -= 7
    if left < 7:
        raise BadObject(
            f"object {obj.id} has {sum(used)} faces in its convex pieces, which is more than a scene "
            "has room for; simplify the mesh and import it again"
        )
    _add_tetrahedra(spec, "ballast_1", (left + 1) // 2)


def _add_tetrahedra(spec: mujoco.MjSpec, name: str, faces: int) -> None:
    """A mesh of so many faces: a tetrahedron's, again and again."""
    corners = np.concatenate([np.zeros((1, 3)), np.eye(3)])
    four = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32)
    spec.add_mesh(
        name=name,
        uservert=corners.ravel(),
        userface=np.resize(four, (faces, 3)).ravel(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )


def add_links(spec: mujoco.MjSpec, robot: Robot) -> list[mujoco.MjsBody]:
    """Add a robot's links and joints, without shapes; the bodies are in the order of the links."""
    drives = {joint.link: joint for joint in robot.joints}
    bodies: list[mujoco.MjsBody] = []
    for i, link in enumerate(robot.links):
        parent = spec.worldbody if link.parent < 0 else bodies[link.parent]
        body = parent.add_body(name=link.name, pos=link.pos, quat=link.quat)
        bodies.append(body)
        body.mass, body.ipos, body.fullinertia, body.explicitinertial = link.mass, link.com, link.inertia, True
        if link.parent < 0:
            body.add_freejoint(name="root")
        elif i in drives:
            joint = drives[i]
            body.add_joint(
                name=joint.name,
                type=mujoco.mjtJoint.mjJNT_HINGE,
                axis=joint.axis,
                range=joint.range,
                limited=mujoco.mjtLimited.mjLIMITED_TRUE,
                armature=robot.armature if joint.armature is None else joint.armature,
                damping=robot.damping,
            )
    return bodies


def _add_robot(spec: mujoco.MjSpec, robot: Robot, visuals: bool) -> None:
    bits = {group: 1 << (i + 1) for i, group in enumerate(dict.fromkeys(shape.group for shape in robot.collision))}
    partners = {group: _WORLD_BIT for group in bits}
    for a, b in robot.collides:
        partners[b] |= bits[a]
    bodies = add_links(spec, robot)
    for shape in robot.collision:
        geom = _add_shape(bodies[shape.link], shape)
        geom.group, geom.friction, geom.mass = ROBOT_GROUP, FRICTION, 0.0
        geom.contype, geom.conaffinity = bits[shape.group], partners[shape.group]
        geom.rgba = _GRAY if not visuals else (0, 0, 0, 0)
    for shape in robot.visual if visuals else ():
        geom = _add_shape(bodies[shape.link], shape)
        geom.group, geom.contype, geom.conaffinity, geom.mass = VISUAL_GROUP, 0, 0, 0.0
        geom.rgba = [*(float(part) for part in shape.group.split()), 1.0]


def _add_shape(body: mujoco.MjsBody, shape: Shape) -> mujoco.MjsGeom:
    geom = body.add_geom(type=getattr(mujoco.mjtGeom, f"mjGEOM_{shape.type.upper()}"))
    if shape.end is not None:
        geom.fromto = [*shape.start, *shape.end]
        geom.size = [shape.size[0], 0, 0]
    else:
        geom.pos = shape.start
        geom.size = [*shape.size, *(0,) * (3 - len(shape.size))]
    return geom


def _add_actuators(spec: mujoco.MjSpec, robot: Robot, preset: str, control: str) -> None:
    gains = robot.gains[preset]
    affine = {
        "position": lambda kp, kd: (kp, (0, -kp, -kd)),
        "velocity": lambda kp, kd: (kd, (0, 0, -kd)),
        "torque": lambda kp, kd: (1.0, (0, 0, 0)),
    }
    if control not in affine:
        raise UnknownName("control mode", control, list(affine))
    for joint, kp, kd in zip(robot.joints, gains.kp, gains.kd, strict=True):
        gain, bias = affine[control](kp, kd)
        actuator = spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        actuator.gaintype, actuator.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
        actuator.gainprm[0] = gain
        actuator.biasprm[:3] = bias
        actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
        actuator.forcerange = [-joint.torque_limit, joint.torque_limit]
