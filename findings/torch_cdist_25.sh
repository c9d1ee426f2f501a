#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" torch==2.13.0 numpy==2.4.6
echo "guess:     the accuracy of torch.cdist does not depend on how many points there are"
echo "behaviour: from 26 points on it multiplies matrices: 10 m from the origin a millimetre becomes 0 to 8 mm in single precision"
python - <<'PYTHON'
import torch

generator = torch.Generator().manual_seed(0)
places = 10.0 + 2.0 * torch.rand(26, 3, generator=generator)
beside = places + torch.tensor([0.001, 0.0, 0.0])
truth = (places - beside).norm(dim=1)
spread = {}
for count in (25, 26):
    found = torch.cdist(places[:count], beside[:count]).diagonal()
    spread[count] = (1000 * float(found.min()), 1000 * float(found.max()))
    print(f"seen:      {count} points: {spread[count][0]:.3f} to {spread[count][1]:.3f} mm; by subtraction {1000 * float(truth[:count].max()):.3f} mm")
exact = torch.cdist(places, beside, compute_mode="donot_use_mm_for_euclid_dist").diagonal()
print(f"           26 points, donot_use_mm_for_euclid_dist: {1000 * float(exact.max()):.3f} mm")
assert max(abs(each - 1.0) for each in spread[25]) < 0.002, "this has changed"
assert spread[26][0] < 0.5 and spread[26][1] > 2.0, "this has changed"
assert torch.equal(exact, truth) or float((exact - truth).abs().max()) < 1e-6, "this has changed"
PYTHON
