"""Families of procedural objects: seen in training, novel, and sealed."""

from collections.abc import Callable

import numpy as np

from pipelines.errors import UnknownNameError
from pipelines.synthesis.objects.families import compound, lathed, prismatic, sealed, wider
from pipelines.synthesis.objects.shape import Shape

Family = Callable[[np.random.Generator], Shape]

# Families of training and of the splits `seen` and `similar`.
SEEN: dict[str, Family] = {
    "can": lathed.can,
    "carton": prismatic.carton,
    "mug": compound.mug,
    "ball": lathed.sphere_ball,
    "hammer": compound.hammer,
    "bottle": lathed.bottle,
    "lumpy": compound.lumpy,
    "bowl": lathed.bowl,
    "soap": prismatic.soap,
    "animal": compound.animal,
    "jar": lathed.jar,
    "polygon_prism": prismatic.polygon_prism,
    "screwdriver": compound.screwdriver,
    "cup": lathed.cup,
    "banana": compound.banana,
    "fruit": lathed.fruit,
    "vehicle": compound.vehicle,
    "tube": lathed.tube,
    "book": prismatic.book,
    "marker": lathed.marker,
    "sculpture": compound.sculpture,
    "mouse": compound.mouse,
    "dumbbell": lathed.dumbbell,
    "bracket": prismatic.bracket,
}

# Families of the split `novel` only.
NOVEL: dict[str, Family] = {
    "spray_bottle": compound.spray_bottle,
    "cube": prismatic.cube,
    "goblet": lathed.goblet,
    "dimpled_ball": lathed.dimpled_ball,
    "clamp": compound.clamp,
    "capsule": lathed.capsule,
    "stone": prismatic.stone,
    "knife": compound.knife,
    "star": prismatic.star,
    "pawn": lathed.pawn,
    "pitcher": compound.pitcher,
    "cross": prismatic.cross_connector,
    "ring": lathed.ring,
    "figure": compound.figure,
    "elbow": prismatic.elbow,
    "cone": lathed.cone,
    "mallet": compound.mallet,
    "wedge": prismatic.wedge,
    "plug": compound.plug,
    "plate": lathed.plate,
    "spoon": compound.spoon,
}

# Further families of training, which the first trainings lack.
WIDER_FAMILIES: dict[str, Family] = {
    "turned": wider.turned,
    "boulder": wider.boulder,
    "pan": wider.pan,
    "decoy_can": wider.decoy_can,
    "pliers": wider.pliers,
    "crossed": wider.crossed,
    "case": wider.case,
    "brush": wider.brush,
    "faceted": wider.faceted,
    "pot": wider.pot,
    "heap": wider.heap,
    "spanner": wider.spanner,
    "spindle": wider.spindle,
    "bucket": wider.bucket,
    "decoy_bottle": wider.decoy_bottle,
    "nut": wider.nut,
    "drill": wider.drill,
    "torch": wider.torch,
    "hook": wider.hook,
    "decoy_carton": wider.decoy_carton,
    "tape_dispenser": wider.tape_dispenser,
}

# Families of the sealed benchmark only.
SEALED: dict[str, Family] = {
    "superquadric": sealed.superquadric,
    "lobed_knob": sealed.lobed_knob,
    "twisted_bar": sealed.twisted_bar,
    "cookie_cutter": sealed.cookie_cutter,
    "horseshoe": sealed.horseshoe,
    "chair": sealed.chair,
    "stairs": sealed.stairs,
    "tripod": sealed.tripod,
    "peanut": sealed.peanut,
    "slipper": sealed.slipper,
    "fish": sealed.fish,
    "carved": sealed.carved,
}

FAMILIES = SEEN | NOVEL | WIDER_FAMILIES | SEALED


def make_shape(family: str, rng: np.random.Generator) -> Shape:
    """Return a new shape of `family`, centred on its bounding box.

    Raises:
        UnknownNameError: the family is unknown.
    """
    if family not in FAMILIES:
        raise UnknownNameError("family", family, FAMILIES)
    return FAMILIES[family](rng).centered()
