"""The machine a library runs on, as far as the last bits of its results may depend on it."""

import importlib.metadata
import platform

from dl2c.native.toolchain import cpu_features

WIDER = ("avx", "fma", "fma4", "avx2", "avx512f", "asimd", "sve")
"""Features by which mathematical libraries choose among variants that round differently."""


def host() -> dict[str, str]:
    """Names of the machine, the system, the C library, features of the CPU, and casadi, whose CVODES solves
    flows. Where these are equal, so are all results, to the last bit.
    """
    features = set(cpu_features().lower().split())
    return {
        "machine": platform.machine(),
        "system": platform.system(),
        "libc": " ".join(platform.libc_ver()).strip() or platform.release(),
        "cpu": " ".join(name for name in WIDER if name in features),
        "casadi": importlib.metadata.version("casadi"),
    }
