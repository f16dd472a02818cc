"""No hit depends on the width of the CPU's vectors, or on whether it has fused multiply-adds.

Warp compiles only for the CPU that it runs on; LLVM's flags restrict the instructions to those of a narrower one.
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


@pytest.mark.long  # each set of flags compiles all kernels of the cast again
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
