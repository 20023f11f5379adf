"""Own blocks whose faces alone do not carry the load: named before a static run.

Deformable blocks press on each other where faces overlap; edges that cross and corners that touch
have no area and carry nothing. If rigid blocks in contact at all corners of all these areas have a
motion that the load drives, every contact pressure does work of one sign on it and no small
displacement is in equilibrium: Newton's method would iterate in vain. One rigid equilibrium shows
it in a fraction of a second.

Where blocks move far (finite sliding) or close gaps first, they may come to rest
elsewhere: that is no proof against such a run, and explains one that failed.
"""

from __future__ import annotations

from dataclasses import dataclass

from geometry.assembly import Assembly
from geometry.mesh import FloatArray
from geometry.parts.pairs import pair_values
from geometry.polyhedra.assembly import PolyhedralAssembly, as_polyhedral
from mbd import contact_jacobian
from mbd.contact_jacobian import Contacts
from mbd.equilibrium import column_weights, newton_equilibrium
from mbd.friction import FrictionalContacts, frictional_contacts, frictional_equilibrium
from mbd.squeeze import squeeze
from validation.build.materials import build_weight, friction_of_pairs
from validation.errors import InputError
from validation.run.held_by_friction import MOST_POINTS, motion_words
from validation.scene.polyhedra import PolyhedralScene
from validation.scene.read import DeformableScene


@dataclass(frozen=True)
class _Faces:
    """Rigid blocks in contact at the corners of the areas that they share."""

    assembly: PolyhedralAssembly
    contacts: Contacts
    force: FloatArray
    """Loads and weight, (n_rows,) [N]."""

    @property
    def touches(self) -> bool:
        """Whether any face meets another."""
        return self.assembly.interfaces.n_contacts > 0


def _faces(scene: DeformableScene, assembly: Assembly) -> _Faces | None:
    """None for other blocks, for curved faces, many contacts, moves, springs, supports by name."""
    curved = any(shape.curve is not None for shape in assembly.shapes)
    if curved or not isinstance(scene, PolyhedralScene) or not scene.for_rigid_blocks:
        return None
    # Loaded here: it reads files, which other scenes have none of.
    from validation.build.polyhedra import own_load

    surfaces = as_polyhedral(assembly, scene.detection.options)
    bare = surfaces.with_faces_alone()
    n = bare.interfaces.n_contacts
    if n > MOST_POINTS or not surfaces.interfaces.n_contacts:
        return None
    load, weight = own_load(scene, assembly), build_weight(scene, assembly)
    if any(isinstance(held.face, str) for held in load.held):
        return None  # surfaces have no names
    contacts = contact_jacobian(bare, load.fixed, load.held)
    return _Faces(bare, contacts, contacts.rows(load.with_wrenches(weight).wrenches))


def _frictional(scene: DeformableScene, faces: _Faces) -> FrictionalContacts:
    """The contacts with the friction of the scene, which may be none."""
    given, contacts = scene.effects.friction, faces.contacts
    of_pairs = () if given is None else friction_of_pairs(scene, faces.assembly)
    default = 0.0 if given is None else given.coefficient
    friction = pair_values(default, of_pairs, contacts.block_m, contacts.block_s)
    return frictional_contacts(faces.assembly, contacts, friction)


def faces_words(scene: DeformableScene, assembly: Assembly) -> str | None:
    """Name the motion of own blocks that the load drives and their faces alone do not stop.

    None where faces carry the load, for other blocks, for curved faces, and for many contacts.
    """
    faces = _faces(scene, assembly)
    if faces is None:
        return None
    if not faces.touches:
        return "blocks touch along edges and at points alone, and edges and points carry nothing"
    result = newton_equilibrium(faces.contacts.jacobian, faces.force)
    motion = result.mechanism
    friction = scene.effects.friction
    if motion is None or result.holds:
        return None
    frictional = _frictional(scene, faces)
    if friction is not None:
        motion = frictional_equilibrium(frictional, faces.force).mechanism
        if motion is None:
            return None
    words = motion_words(faces.contacts, frictional, motion, faces.force)
    return f"the load activates a mechanism of the faces ({words}; edges and corners carry no load)"


def squeeze_words(scene: DeformableScene, assembly: Assembly) -> str | None:
    """Words where only a squeeze beforehand lets friction carry the load of own blocks."""
    faces, friction = _faces(scene, assembly), scene.effects.friction
    if faces is None or friction is None or not faces.touches:
        return None
    frictional = _frictional(scene, faces)
    assert isinstance(scene, PolyhedralScene)
    weights = column_weights(scene.rigid.norm, faces.contacts.areas)
    answer = frictional_equilibrium(frictional, faces.force, weights=weights)
    if not answer.holds:
        return None
    result = squeeze(faces.contacts, frictional, faces.force, answer.forces, weights=weights)
    return f"{result.words()}; the load does not press them" if result.needed else None


def require_held_by_faces(name: str, scene: DeformableScene, assembly: Assembly) -> None:
    """Reject a static run of own blocks whose faces alone do not carry the load."""
    if scene.effects.finite_sliding or not scene.meets or scene.contact.opened:
        return
    words = faces_words(scene, assembly)
    if words is not None:
        raise InputError(
            f"{name}: no equilibrium: {words}; expected faces that carry the load: `tubelock mbd` "
            "shows the motion; change the shape, fix more blocks, add effects.friction, or follow "
            'the motion with fem.method = "explicit"'
        )
