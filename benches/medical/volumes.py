"""Writes a solid as a label map: volumes.py SOLID COLUMN ROW SLICE OUT.nii.gz

A voxel shows the label if its centre is inside. Prints the volume of these voxels.
"""

import json
import sys

import nibabel
import numpy as np
import solids

# Of a voxel: so that no symmetry of a solid lies on a lattice.
SHIFT = 0.37
MARGIN = 3


def voxels(solid, box, spacing):
    """The mask [x, y, z] and the centre of its first voxel, LPS."""
    low, high = (np.asarray(corner, float) for corner in box)
    first = low - (MARGIN - SHIFT) * spacing
    size = np.ceil((high - first) / spacing).astype(int) + MARGIN
    x, y, z = (first[axis] + spacing[axis] * np.arange(size[axis]) for axis in range(3))
    mask = np.zeros(size, np.uint8)
    for k, height in enumerate(z):
        mask[:, :, k] = solid(np.stack(np.meshgrid(x, y, [height], indexing="ij"), -1))[:, :, 0] < 0
    return mask, first


def main():
    name, *spacing, out = sys.argv[1:]
    spacing = np.array([float(length) for length in spacing])
    mask, first = voxels(*solids.SOLIDS[name][0](), spacing)
    affine = np.diag([*spacing, 1.0])
    affine[:3, 3] = first
    # NIfTI counts x to the right and y to the front.
    image = nibabel.Nifti1Image(mask, np.diag([-1.0, -1.0, 1.0, 1.0]) @ affine)
    image.header.set_xyzt_units("mm")
    nibabel.save(image, out)
    print(json.dumps({"voxels": int(mask.sum()), "volume": float(mask.sum() * spacing.prod())}))


if __name__ == "__main__":
    main()
