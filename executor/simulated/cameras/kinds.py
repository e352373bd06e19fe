"""Names of the simulated cell's cameras."""

from typing import Literal, get_args

# solid bodies by the cell's own rays and waves; or the compiler's renderer
CameraKind = Literal["solid", "quick"]
CAMERAS: tuple[CameraKind, ...] = get_args(CameraKind)
