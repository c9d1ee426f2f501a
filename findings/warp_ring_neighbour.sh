#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" warp-lang==1.19.0 numpy==2.4.6
echo "guess:     (i - 1) % n in a kernel is what it is in Python, the neighbour on a ring; (i - 1) // n fits it"
echo "behaviour: % is C's, -1 for the first, and // is Python's: (a // n) * n + a % n is not a; angles % 2 pi stay negative"
cat > ring.py <<'PYTHON'
import numpy as np
import warp as wp

wp.config.quiet, wp.config.kernel_cache_dir = True, "kernels"


@wp.kernel
def divided(count: int, angles: wp.array(dtype=float), whole: wp.array(dtype=int), rest: wp.array(dtype=int), turned: wp.array(dtype=float)):
    i = wp.tid()
    whole[i] = (i - 1) // count
    rest[i] = (i - 1) % count
    turned[i] = angles[i] % 6.0


angles = np.array([-7.0, -1.0, 1.0, 7.0], dtype=np.float32)
whole, rest, turned = wp.zeros(4, dtype=int), wp.zeros(4, dtype=int), wp.zeros(4, dtype=float)
wp.launch(divided, dim=4, inputs=[4, wp.array(angles), whole, rest, turned], device="cpu")
whole, rest, turned = whole.numpy(), rest.numpy(), turned.numpy()
number = np.arange(4) - 1
print(f"seen:      for {number.tolist()} by 4: // {whole.tolist()}, % {rest.tolist()}, together {(whole * 4 + rest).tolist()}; in Python {(number // 4).tolist()}, {(number % 4).tolist()};")
print(f"           {angles.tolist()} % 6.0 is {turned.tolist()}; in Python {(angles % 6).tolist()}")
assert whole.tolist() == [-1, 0, 0, 0] and rest.tolist() == [-1, 0, 1, 2] and turned.tolist() == [-1, -1, 1, 1], "this has changed"
PYTHON
python ring.py
