"""No answer depends on how wide the CPU's vectors are, or on whether it fuses products with sums.

Warp compiles for the CPU that it finds and knows no other, so a narrower one is made by telling LLVM to use less of it.
"""

import subprocess
import sys
from pathlib import Path
from platform import machine

import pytest
import warp as wp

X86 = ("x86_64", "AMD64")
SCRIPT = Path(__file__).parent / "cast_with_flags.py"


def digest(flags: str) -> str:
    done = subprocess.run([sys.executable, str(SCRIPT), flags], capture_output=True, text=True, check=True)
    return done.stdout.splitlines()[-1]


@pytest.mark.long  # every width is a compilation of all that casts
@pytest.mark.skipif(not hasattr(wp.config, "cpu_compiler_flags"), reason="this Warp has no such option")
@pytest.mark.parametrize(
    "flags",
    [
        "-march=native -mprefer-vector-width=512",
        "-march=native -mprefer-vector-width=128",
        "-march=native -fno-vectorize -fno-slp-vectorize",
        pytest.param(
            "-march=native -target-feature -fma -target-feature -avx512f",
            marks=pytest.mark.skipif(machine() not in X86, reason="another kind of CPU"),
        ),
    ],
    ids=["512 bits", "128 bits", "scalar", "without fused products"],
)
def test_vectors_of_the_cpu_do_not_show(flags: str) -> None:
    assert digest(flags) == digest("")
