#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" imageio==2.38.1 imageio-ffmpeg==0.8.1 numpy==2.4.6
echo "guess:     a video with dropped frames is read frame by frame, or repeated at its stated rate, so that number / rate is the time"
echo "behaviour: dropped frames are repeated, at the camera's rate; the stated rate is the mean one: 1 s becomes 1.5 s"
python - <<'PYTHON'
import subprocess

import imageio.v2 as imageio
import imageio_ffmpeg
import numpy as np

ffmpeg = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-f", "lavfi", "-i", "testsrc=size=64x64:rate=30:duration=1"]
select = ["-vf", "select='not(between(n,10,19))'", "-fps_mode", "vfr", "-pix_fmt", "yuv420p"]
subprocess.run([*ffmpeg, *select, "camera.mp4"], check=True)
reader = imageio.get_reader("camera.mp4")
frames, rate, stored = [*iter(reader)], reader.get_meta_data()["fps"], reader.count_frames()
same = [number for number, (frame, last) in enumerate(zip(frames[1:], frames), 1) if np.array_equal(frame, last)]
print(f"seen:      of 1 s at 30 Hz without the frames 10 to 19: {stored} are stored, {len(frames)} read, {same} repeat the one before;")
print(f"           at the stated rate of {rate} Hz they last {len(frames) / rate} s")
assert (stored, len(frames), rate) == (20, 30, 20.0) and same == list(range(10, 20)), "this has changed"
PYTHON
