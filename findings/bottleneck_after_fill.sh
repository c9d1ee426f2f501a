#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" bottleneck==1.6.0 pandas==3.1.1 numpy==2.4.6
echo "guess:     one fill value, as netCDF writes for what is missing, spoils the moving means of the windows that it is in"
echo "behaviour: Bottleneck's of all later windows are 0, and its moving standard deviations 0 to 40 times too large; those of pandas are right"
python - <<'PYTHON'
import bottleneck
import numpy as np
import pandas as pd

heights = 1.2 + 0.001 * np.sin(np.arange(40.0))
heights[5] = 9.969209968386869e36
later = slice(12, None)  # windows of 5
mean, spread = bottleneck.move_mean(heights, 5)[later], bottleneck.move_std(heights, 5, ddof=1)[later]
rolling = pd.Series(heights).rolling(5)
right = rolling.mean()[later], rolling.std()[later]
print(f"seen:      means of later windows {mean.min():.4f} to {mean.max():.4f} m, of pandas {right[0].min():.4f} to {right[0].max():.4f};")
print(f"           standard deviations {spread.min():.4f} to {spread.max():.4f} m, of pandas {right[1].min():.4f} to {right[1].max():.4f}")
assert abs(mean).max() < 0.001 and spread.max() > 10 * right[1].max(), "this has changed"
assert abs(right[0] - 1.2).max() < 0.001 and right[1].max() < 0.001, "this has changed"
PYTHON
