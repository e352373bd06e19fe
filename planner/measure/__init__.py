"""Poses of a task's target in pictures of it, without a plan.

In: `Task`, the id of a step, PNG and TIFF files of a camera.
Out: where the target is in each picture, how surely, and whether gates accept it.
The type that passes: `PictureLook` (picture_look), `MeasuredPicture` (measuring).
May be touched here: which files are read, what is said of an answer; how good one is
belongs to trials, its gates to looks. tifffile and skimage are imported in
picture_files alone, cv2 in marking alone.
Watched by: tests/planner/measure
"""
