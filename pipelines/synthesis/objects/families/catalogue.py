"""Families of procedural objects: seen in training, and novel."""

from collections.abc import Callable

import numpy as np

from pipelines.errors import UnknownNameError
from pipelines.synthesis.objects.families import compound, lathed, prismatic
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

FAMILIES = SEEN | NOVEL


def make_shape(family: str, rng: np.random.Generator) -> Shape:
    """Return a new shape of `family`, centred on its bounding box.

    Raises:
        UnknownNameError: there is no such family.
    """
    if family not in FAMILIES:
        raise UnknownNameError("family", family, FAMILIES)
    return FAMILIES[family](rng).centred()
