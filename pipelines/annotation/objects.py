"""Annotation of one object: symmetries and regions detected, given, or corrected by hand."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pipelines.array_types import Indices
from pipelines.configs import AnnotateSymmetryConfig
from pipelines.dataset.meshes import clean_mesh
from pipelines.dataset.symmetry import regions as manual_regions
from pipelines.dataset.symmetry import symmetry_edits
from pipelines.dataset.symmetry.symmetry_edits import ObjectEdits
from pipelines.dataset.symmetry.symmetry_labels import (
    BY_HAND,
    FOUND,
    FROM_BOP,
    ObjectSymmetries,
)
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.symmetry import (
    ObjectRegion,
    ReflectionSymmetry,
    RotationSymmetry,
    SphereSymmetry,
    Symmetry,
)
from pipelines.mesh_symmetry.detection.symmetry_detection import (
    MeshSymmetries,
    analyse,
    detect_symmetries,
)
from pipelines.mesh_symmetry.doubt import Gauge
from pipelines.mesh_symmetry.parts.part_symmetries import is_same
from pipelines.mesh_symmetry.parts.symmetric_parts import (
    WHOLE_REGION,
    has_slot,
    symmetric_regions,
)

THROUGH_COSINE = float(np.cos(np.radians(85.0)))  # of a plane's normal and an axis in it


@dataclass(frozen=True)
class SourcedSymmetries:
    """Symmetries, their sources, and warnings about symmetries that do not fit the mesh."""

    symmetries: tuple[Symmetry, ...]
    sources: tuple[str, ...]
    notes: tuple[str, ...] = ()


def annotate(
    mesh: Mesh,
    name: str,
    config: AnnotateSymmetryConfig,
    rng: np.random.Generator,
    *,
    regions_path: Path | None = None,
    given: Sequence[Symmetry] = (),
    edits: ObjectEdits | None = None,
) -> tuple[ObjectSymmetries, tuple[str, ...]]:
    """Return the annotation of `mesh`, object frame, metres, and notes on problems.

    Triangles without area and duplicates are ignored. `regions_path`: regions by hand, which
    replace the detected ones. `given`: rotation or sphere of another source, which replaces the
    detected one. `edits`: corrections by hand of the detected symmetries.

    Raises:
        ValueRangeError: no triangle has an area.
        SymgraspError: a correction names a symmetry that the object does not have.
    """
    cleaned, kept, dropped = clean_mesh(mesh)
    gauge = Gauge.of(cleaned, config, rng.spawn(1)[0])
    detection = analyse(cleaned, config, rng)
    sourced = _with_given(detection.symmetries, given, gauge)
    assessment = gauge.assess(sourced.symmetries, detection.partial)
    labels = ObjectSymmetries(
        name,
        sourced.symmetries,
        doubt=assessment.doubt,
        rejected=assessment.rejected,
        sources=sourced.sources,
    )
    notes = (*filter(None, [dropped]), *sourced.notes)
    if edits is not None:
        labels, more = _edited(labels, edits, gauge)
        notes += more
    if regions_path is not None:
        regions = _given_regions(mesh, regions_path, config, rng)
    else:
        regions = _found_regions(mesh, cleaned, kept, _decided(detection, labels), config, rng)
    return replace(labels, regions=regions), notes


def correct(
    mesh: Mesh,
    labels: ObjectSymmetries,
    edits: ObjectEdits,
    config: AnnotateSymmetryConfig,
    rng: np.random.Generator,
    regions_path: Path | None = None,
) -> tuple[ObjectSymmetries, tuple[str, ...]]:
    """Return a finished annotation of `mesh` with `edits` applied to the symmetries found.

    Earlier corrections are undone, since `edits` holds all corrections. The parts are cut again,
    because they depend on the symmetries of the whole.
    """
    cleaned, kept, _ = clean_mesh(mesh)
    if labels.found is not None:
        labels = replace(labels, symmetries=labels.found, sources=labels.found_sources, found=None)
    labels, notes = _edited(labels, edits, Gauge.of(cleaned, config, rng.spawn(1)[0]))
    if regions_path is not None:
        return labels, notes
    decided = _decided(analyse(cleaned, config, rng), labels)
    regions = _found_regions(mesh, cleaned, kept, decided, config, rng)
    return replace(labels, regions=regions), notes


def _edited(
    labels: ObjectSymmetries, edits: ObjectEdits, gauge: Gauge
) -> tuple[ObjectSymmetries, tuple[str, ...]]:
    symmetries, sources = symmetry_edits.apply(
        edits, labels.symmetries, labels.all_sources, labels.rejected
    )
    measured = _measured(symmetries, sources, gauge, BY_HAND)
    # A person has checked the object, so its doubt is 0.
    edited = replace(
        labels,
        symmetries=measured.symmetries,
        sources=measured.sources,
        doubt=0.0,
        found=labels.symmetries,
        found_sources=labels.all_sources,
    )
    return edited, measured.notes


def _decided(detection: MeshSymmetries, labels: ObjectSymmetries) -> MeshSymmetries:
    """Return `detection` with the symmetries of `labels`, those of BOP or a person included."""
    left = labels.symmetries
    found = (*detection.symmetries, *(labels.found or ()))
    dropped = tuple(each for each in found if not any(is_same(each, other) for other in left))
    return replace(detection, symmetries=list(left), dropped=dropped)


def _with_given(
    found: Sequence[Symmetry], given: Sequence[Symmetry], gauge: Gauge
) -> SourcedSymmetries:
    """Return `found` with its rotation or sphere replaced by the one of `given`."""
    if not given:
        return SourcedSymmetries(tuple(found), (FOUND,) * len(found))
    if any(isinstance(symmetry, SphereSymmetry) for symmetry in given):
        planes: list[Symmetry] = []
    else:
        planes = [s for s in found if isinstance(s, ReflectionSymmetry)]
    for symmetry in given:
        if isinstance(symmetry, RotationSymmetry) and symmetry.order is None:
            # The planes through the axis follow from it.
            axis = symmetry.axis
            planes = [s for s in planes if abs(s.direction @ axis) > THROUGH_COSINE]
    sources = (*(FOUND,) * len(planes), *(FROM_BOP,) * len(given))
    return _measured([*planes, *given], sources, gauge, FROM_BOP)


def _measured(
    symmetries: Sequence[Symmetry], sources: Sequence[str], gauge: Gauge, source: str
) -> SourcedSymmetries:
    """Return the symmetries; symmetries from `source` get their errors on the mesh."""
    measured, notes = [], []
    for symmetry, origin in zip(symmetries, sources, strict=True):
        if origin != source:
            measured.append(symmetry)
            continue
        measure = gauge.measure(symmetry)
        measured.append(replace(symmetry, error=measure.error))
        if measure.strain > 1.0:
            notes.append(
                f"warning: the {symmetry.kind} by {source} does not fit the mesh well, error "
                f"{measure.error:.3f}; limits {measure.strain:.1f} times as wide would accept it"
            )
    return SourcedSymmetries(tuple(measured), tuple(sources), tuple(notes))


def _found_regions(
    mesh: Mesh,
    clean: Mesh,
    kept: Indices,
    detection: MeshSymmetries,
    config: AnnotateSymmetryConfig,
    rng: np.random.Generator,
) -> tuple[ObjectRegion, ...]:
    """Return the symmetric parts of `mesh`; without cutting, the whole if symmetric.

    `clean`: the triangles `kept` (k,) of `mesh`, on which the symmetries were detected.
    """
    found: list[ObjectRegion] = []
    if config.cut_objects:
        found = symmetric_regions(clean, detection, config, rng)
    elif has_slot(detection.symmetries):
        whole = np.arange(len(clean.faces))
        found = [ObjectRegion(WHOLE_REGION, whole, tuple(detection.symmetries))]
    return tuple(replace(each, triangles=_in_file(mesh, kept, each.triangles)) for each in found)


def _given_regions(
    mesh: Mesh, path: Path, config: AnnotateSymmetryConfig, rng: np.random.Generator
) -> tuple[ObjectRegion, ...]:
    regions = []
    for given in manual_regions.read(path, mesh):
        found = given.symmetries
        if found is None:
            found = tuple(detect_symmetries(mesh.submesh(given.triangles), config, rng))
        regions.append(ObjectRegion(given.name, given.triangles, found))
    return tuple(regions)


def _in_file(mesh: Mesh, kept: Indices, triangles: Indices) -> Indices:
    """Return the indices in `mesh` of `triangles` of its cleaned copy, with their duplicates."""
    if len(triangles) == len(kept):
        return np.arange(len(mesh.faces))
    corners = np.unique(np.sort(mesh.faces, axis=1), axis=0, return_inverse=True)[1].reshape(-1)
    return np.flatnonzero(np.isin(corners, corners[kept[triangles]]))
