"""Tables and pictures of docs/benchmarks.md from the results.

python -m benchmarks.report
"""

import re
from pathlib import Path
from typing import Any

from benchmarks.measure import RESULTS, load

PAGE = Path(__file__).parent.parent / "docs" / "benchmarks.md"
PICTURES = PAGE.parent / "pictures"
HARD_SETS = ("random", "straight elbow", "near straight", "aligned", "unreachable")


def write(page: Path = PAGE, folder: Path = RESULTS, pictures: Path = PICTURES) -> None:
    """Renew what stands between marks of a page, ``<!-- name -->`` to ``<!-- /name -->``, where there are results."""
    text = page.read_text()
    for name, tables in TABLES.items():
        if not (folder / f"{name}.json").exists():
            continue
        found = load(name, folder)
        body = "\n\n".join([_measured(found), *[part for part in tables(found) if part], *_left_out(found)])
        text = re.sub(
            f"(<!-- {name} -->).*?(<!-- /{name} -->)", lambda m, b=body: f"{m[1]}\n{b}\n{m[2]}", text, flags=re.S
        )
        if name == "scaling":
            _pictures(found, pictures)
    page.write_text(text)


def table(header: tuple[str, ...], rows: list[tuple[Any, ...]]) -> str:
    """Return a table in Markdown."""
    lines = [header, tuple("---" for _ in header), *rows]
    return "\n".join("| " + " | ".join(_cell(x) for x in line) + " |" for line in lines)


def _cell(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, float):
        if value == 0 or 1e-2 <= abs(value) < 1e5:
            return f"{value:.3g}" if abs(value) < 1000 else f"{value:,.0f}".replace(",", " ")
        return f"{value:.1e}"
    return str(value)


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{100 * share:.4g} %"


def _measured(found: dict[str, Any]) -> str:
    machine, versions = found["machine"], found["versions"]
    listed = ", ".join(f"{name} {number}" for name, number in sorted(versions.items(), key=lambda x: x[0].lower()))
    kind = "the full run" if found["settings"].get("full") else "a quick run"
    busy = (
        ""
        if machine["load"] <= machine["cores"]
        else (
            " **The machine was busy with other work: times and rates of this run say little; errors and shares do.**"
        )
    )
    return (
        f"Measured {found['date']} in {kind}: {machine['processor']}, {machine['cores']} cores, "
        f"{machine['memory_gib']} GiB, load {machine['load']} at the end; {machine['system']}; {listed}.{busy}"
    )


def _left_out(found: dict[str, Any]) -> list[str]:
    if not found["errors"]:
        return []
    lines = [f"- {e['peer']} ({e['step']}): `{e['message']}`" for e in found["errors"]]
    return ["Left out:\n\n" + "\n".join(lines)]


def _ik(found: dict[str, Any]) -> list[str]:
    random = [row for row in found["rows"] if row["set"] == "random"]
    random.sort(key=lambda row: -row["solutions_per_s"])
    keys = ("peer", "arm", "returns", "poses_per_s", "solutions_per_s", "latency_us", "first_call_s", "cores_used")
    header = ("solver", "arm", "returns", "poses/s", "solutions/s", "one pose [µs]", "first call [s]", "cores used")
    rates = table(header, [tuple(row[key] for key in keys) for row in random])
    keys = ("peer", "position_median", "position_worst", "rotation_median", "rotation_worst")
    header = ("solver", "median [m]", "worst [m]", "median [rad]", "worst [rad]", "answers that are wrong")
    errors = table(header, [(*(row[key] for key in keys), _percent(row["wrong_answers"])) for row in random])
    sets = {(row["peer"], row["set"]): row for row in found["rows"]}
    shares = []
    for name in [row["peer"] for row in random]:
        cells: list[Any] = [name]
        for which in HARD_SETS:
            row = sets.get((name, which))
            if row is None:
                cells.append(None)
            elif which == "unreachable":
                cells.append(_percent(1 - row["claimed"]))
            else:
                wrong = f" ({_percent(row['wrong_answers'])} wrong)" if row["wrong_answers"] else ""
                cells.append(_percent(row["reached_within_limits"]) + wrong)
        shares.append(tuple(cells))
    return [rates, errors, table(("solver", *HARD_SETS[:-1], "unreachable, said so"), shares)]


def _arcs(found: dict[str, Any]) -> list[str]:
    header = ("solver", "returns", "poses", "µs per pose", "cores used", "first call [s]", "differs by [rad]")
    keys = ("peer", "returns", "poses", "us_per_pose", "cores_used", "first_call_s", "largest_difference")
    return [table(header, [tuple(row[key] for key in keys) for row in found["rows"]])]


def _paths(found: dict[str, Any]) -> list[str]:
    header = (
        "solver",
        "energy",
        "worst [m]",
        "worst [rad]",
        "beyond limits [rad]",
        "speed / limit",
        "cold [s]",
        "warm [s]",
    )
    keys = ("peer", "energy", "position_worst", "rotation_worst", "beyond_limits", "speed_ratio", "cold_s", "warm_s")
    parts = []
    for path in dict.fromkeys(row["path"] for row in found["rows"]):
        rows = sorted((r for r in found["rows"] if r["path"] == path), key=lambda r: r["energy"])
        parts.append(f"`{path}`, {rows[0]['waypoints']} waypoints:")
        parts.append(table(header, [tuple(row[key] for key in keys) for row in rows]))
    return parts


def _scaling(found: dict[str, Any]) -> list[str]:
    parts = []
    for kind, what in (("batch", "poses"), ("path", "waypoints"), ("devices", "devices")):
        rows = [row for row in found["rows"] if row["kind"] == kind]
        if not rows:
            continue
        sizes = sorted({row["size"] for row in rows})
        names = list(dict.fromkeys(row["peer"] for row in rows))
        at = {(row["peer"], row["size"]): row["seconds"] for row in rows}
        parts.append(f"Seconds per call, by number of {what}:")
        parts.append(table(("solver", *map(str, sizes)), [(n, *(at.get((n, s)) for s in sizes)) for n in names]))
    return parts


def _accelerator(found: dict[str, Any]) -> list[str]:
    agreement = [row for row in found["rows"] if row["kind"] == "agreement"]
    rates = [row for row in found["rows"] if row["kind"] != "agreement"]
    first = ("function", "dtype", "rows", "difference_median", "difference_worst", "tolerance", "rows_beyond")
    second = ("function", "dtype", "rows", "rows_per_s", "first_call_s", "peak_memory_gib")
    return [
        f"Device: {found['machine']['device']}.",
        table(tuple(x.replace("_", " ") for x in first), [tuple(row[key] for key in first) for row in agreement]),
        table(tuple(x.replace("_", " ") for x in second), [tuple(row[key] for key in second) for row in rates]),
    ]


def _pictures(found: dict[str, Any], folder: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, 2, figsize=(11, 4.5), layout="constrained")
    for axis, kind, what in zip(axes, ("batch", "path"), ("poses per call", "waypoints"), strict=True):
        rows = [row for row in found["rows"] if row["kind"] == kind]
        for name in dict.fromkeys(row["peer"] for row in rows):
            mine = sorted((row["size"], row["seconds"]) for row in rows if row["peer"] == name)
            style = {"linewidth": 2.5} if name.startswith("jaxik") else {"linewidth": 1, "alpha": 0.8}
            axis.loglog(*zip(*mine, strict=True), marker=".", label=name, **style)
        axis.set(xlabel=what, ylabel="seconds per call")
        axis.grid(alpha=0.3)
        axis.legend(fontsize=7)
    figure.savefig(folder / "scaling.png", dpi=110)
    pyplot.close(figure)


TABLES = {"ik": _ik, "arcs": _arcs, "paths": _paths, "scaling": _scaling, "accelerator": _accelerator}


if __name__ == "__main__":
    write()
