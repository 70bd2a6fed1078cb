"""How an exported controller finds values of inputs that pass: copies of cgen/monitor/values.h."""

from dl2c.emit.monitor.copied import copied


def search_functions(stem: str, most: int, single: bool, quadratic: bool, squash: bool) -> str:
    """What runs with inputs need. `most` counts the roots of an input and the two ends of its range."""
    names = ["MOST", "search", "passes", *(["enter"] if most > 2 else [])]
    names += ["enter_roots"] if quadratic else []
    names += ["last_passing", "nearest", *(["spread"] if squash else [])]
    suffix = "f" if single else ""
    words = {
        "MODEL": stem,
        "VALUES_MOST": str(most),
        "VALUES_SQRT": f"sqrt{suffix}",
        "VALUES_ABS": f"fabs{suffix}",
        "VALUES_HALVINGS": "26" if single else "55",
    }
    return copied("values.h", tuple(names), words)
