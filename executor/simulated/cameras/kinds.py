"""Names of the simulated cell's cameras."""

from typing import Literal, get_args

# solid bodies by the cell's own rays and waves; or the compiler's renderer
CameraKind = Literal["solid", "quick"]
JUDGE: CameraKind = "solid"  # it alone judges images, and is the usual one
CAMERAS: tuple[CameraKind, ...] = get_args(CameraKind)
