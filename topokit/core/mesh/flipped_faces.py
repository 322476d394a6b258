"""Faces that run around their corners in the opposite order of their neighbors."""

from __future__ import annotations

import numpy as np

from topokit.core.arrays import Booleans, Integers
from topokit.core.labels import connected_labels
from topokit.core.mesh.connectivity import MeshConnectivity


def flipped_faces(mesh: MeshConnectivity) -> tuple[Booleans, Booleans]:
    """Which faces (F,) oppose the majority of their patch, and which lie in a patch that cannot be oriented.

    Works on two copies of every face, as given and turned over: neighbors that agree join like to like, others
    crosswise. A patch in which a face meets its own turned copy is not orientable and is left as it is.
    """
    first, second = mesh.twins
    corners = mesh.faces.ravel()
    agree = corners[first] != corners[second]
    n_faces = len(mesh.faces)
    if agree.all():
        return np.zeros(n_faces, dtype=bool), np.zeros(n_faces, dtype=bool)
    a, b = first // 3, second // 3
    crosswise = np.where(agree, b, b + n_faces), np.where(agree, b + n_faces, b)
    sheets = connected_labels(2 * n_faces, np.concatenate((a, a + n_faces)), np.concatenate(crosswise))
    given, opposite = sheets[:n_faces], sheets[n_faces:]
    sizes = np.bincount(given, minlength=int(sheets.max()) + 1)
    is_smaller = (sizes[given] < sizes[opposite]) | ((sizes[given] == sizes[opposite]) & (given > opposite))
    is_twisted = given == opposite
    return is_smaller & ~is_twisted, is_twisted


def turned_over(faces: Integers, flip: Booleans) -> Integers:
    """Faces (F, 3) of which some have the opposite order of corners."""
    return np.where(flip[:, None], faces[:, ::-1], faces) if flip.any() else faces
