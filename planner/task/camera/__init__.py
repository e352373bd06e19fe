"""The camera as the workcell states it: sensor, response, noise, fixed pattern.

In: the `camera` section of a workcell file, checked against its schema.
Out: a `CameraSpec` of planner.task.workcell; findings MP116 at lines that contradict.
The type that passes: `Checked` (planner.source.schema).
May be touched here: keys of `camera`; not what an image is (optics.lens).
Watched by: tests/planner/task/camera.
"""
