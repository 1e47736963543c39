#!/usr/bin/env python3
"""Reconstructs the clouds of a bench and holds the meshes against the true surfaces.

    quality.py BENCH [--only PATTERN] [--out FOLDER] [-- ARGUMENTS OF meshway reconstruct]

BENCH holds bare/*.ply, truth/*.ply, index.json (truth and class of each cloud) and peers.json (what other
tools reached). Prints a Markdown table a class: geometric means over its clouds, the peers beside them, and
writes tables, their picture (SVG) and the figures (JSON) to FOLDER. Chamfer: mean of both directed mean
distances; Hausdorff-95: the larger 95 % quantile; both in % of the diagonal of the true surface.
"""

import argparse
import json
import math
import pathlib
import re
import subprocess
import sys
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
MESHWAY = ROOT / "target" / "release" / "meshway"

# Peers that get the true normals end so; they are not rivals on bare points.
TRUE_NORMALS = "_T"


def truth_argument(bench, truth):
    """A shape in our notation, or the file."""
    name, colon, sizes = truth.partition(":")
    return f"{name}:{sizes.replace(',', ':')}" if colon else str(bench / truth)


def measure(bench, name, entry, out, arguments):
    """Figures of one cloud; None for what could not be reconstructed."""
    mesh = out / f"{name}.ply"
    command = [MESHWAY, "reconstruct", bench / "bare" / f"{name}.ply", "-q", "-o", mesh]
    start = time.monotonic()
    done = subprocess.run([*command, *arguments], capture_output=True, text=True)
    seconds = time.monotonic() - start
    if done.returncode != 0:
        print(f"{name}: {done.stderr.strip()}", file=sys.stderr)
        return {"name": name, "seconds": seconds, "chamfer": None}
    truth = truth_argument(bench, entry["truth"])
    judged = subprocess.run(
        [MESHWAY, "evaluate", mesh, truth], capture_output=True, text=True, check=True
    )
    judged = json.loads(judged.stdout)
    comparison, topology = judged["comparison"], judged["mesh"]
    return {
        "name": name,
        "seconds": seconds,
        "chamfer": comparison["chamfer_percent"],
        "hausdorff_95": comparison["hausdorff_95_percent"],
        "closed": topology["closed"] and topology["manifold"],
        "components": topology["components"],
        "genus": topology["genus"],
    }


def true_genus(bench, truth):
    """Of the shape or the file; None where that is not closed."""
    known = {"sphere": 0, "torus": 1}
    shape = truth.partition(":")[0]
    if shape in known:
        return known[shape]
    judged = subprocess.run([MESHWAY, "evaluate", bench / truth], capture_output=True, text=True, check=True)
    return json.loads(judged.stdout)["mesh"]["genus"]


def geometric_mean(values):
    values = [v for v in values if v is not None]
    return math.exp(sum(map(math.log, values)) / len(values)) if values else math.nan


def peers_of(peers, names):
    """Geometric means of each peer that did all clouds."""
    tools = set.intersection(*(set(peers.get(name, {})) for name in names))
    rows = {}
    for tool in tools:
        figures = [peers[name][tool] for name in names]
        if any(not f.get("chamfer_l1_pct") for f in figures):
            continue
        rows[tool] = [
            geometric_mean([f[key] for f in figures])
            for key in ("chamfer_l1_pct", "hausdorff95_pct", "cpu_s")
        ]
    return rows


def by_normals(peers):
    """Tools and figures, the best Chamfer first: those on bare points, and those with true normals."""
    best = sorted(peers.items(), key=lambda item: item[1][0])
    return [
        [item for item in best if item[0].endswith(TRUE_NORMALS) == favoured] for favoured in (False, True)
    ]


def table(title, ours, peers, genera):
    done = [row for row in ours if row["chamfer"] is not None]
    right = sum(row["genus"] == genera[row["name"]] for row in done)
    means = [geometric_mean([row[key] for row in done]) for key in ("chamfer", "hausdorff_95", "seconds")]
    lines = [
        f"### {title}: {len(done)} of {len(ours)} clouds, {sum(row['closed'] for row in done)} closed, "
        f"{sum(row['components'] == 1 for row in done)} in one piece, {right} of the right genus",
        "",
        "| tool | Chamfer | Hausdorff-95 | seconds |",
        "|---|---|---|---|",
        "| **meshway** | **{:.4f}** | **{:.3f}** | **{:.1f}** |".format(*means),
    ]
    bare, given = by_normals(peers)
    for tool, figures in bare[:3] + given[:1]:
        lines.append("| {} | {:.4f} | {:.3f} | {:.1f} |".format(tool, *figures))
    return "\n".join(lines) + "\n"


# Of the picture, in pixels.
WIDTH, LEFT, RIGHT, ROW = 760, 170, 30, 34


def picture(rows):
    """Chamfer of ours and of the peers, a line a class, on a logarithmic axis, as SVG."""
    every = [value for _, ours, bare, given in rows for value in [ours, *bare, *given]]
    low, high = (math.floor(math.log10(min(every))), math.ceil(math.log10(max(every))))
    height = ROW * (len(rows) + 2)

    def x(value):
        return LEFT + (WIDTH - LEFT - RIGHT) * (math.log10(value) - low) / (high - low)

    def dot(value, y, radius, colour):
        return f'<circle cx="{x(value):.1f}" cy="{y}" r="{radius}" fill="{colour}"/>'

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" font-family="sans-serif" '
        'font-size="13"><rect width="100%" height="100%" fill="#fff"/>',
        f'<text x="{LEFT}" y="20">Chamfer, % of the diagonal:</text>',
    ]
    for k, (name, colour) in enumerate([("meshway", "#d1495b"), ("others", "#9aa5b1"), ("with true normals", "#4f86c6")]):
        parts.append(f'<circle cx="{375 + 110 * k}" cy="16" r="5" fill="{colour}"/>')
        parts.append(f'<text x="{385 + 110 * k}" y="20">{name}</text>')
    for power in range(low, high + 1):
        at = f"{x(10.0**power):.1f}"
        parts.append(f'<line x1="{at}" x2="{at}" y1="{ROW}" y2="{height - ROW}" stroke="#ddd"/>')
        parts.append(f'<text x="{at}" y="{height - 12}" text-anchor="middle">{10.0**power:g}</text>')
    for k, (title, ours, bare, given) in enumerate(rows):
        y = ROW * (k + 1) + ROW // 2
        parts.append(f'<text x="10" y="{y + 4}">{title}</text>')
        parts += [dot(value, y, 4, "#9aa5b1") for value in bare]
        parts += [dot(value, y, 4, "#4f86c6") for value in given]
        parts.append(dot(ours, y, 7, "#d1495b"))
    return "\n".join([*parts, "</svg>\n"])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bench", type=pathlib.Path)
    parser.add_argument("--only", default="", help="clouds whose names match this regular expression")
    parser.add_argument("--out", type=pathlib.Path, default=ROOT / "target" / "bench" / "quality")
    split = sys.argv.index("--") if "--" in sys.argv else len(sys.argv)
    options = parser.parse_args(sys.argv[1:split])
    arguments = sys.argv[split + 1 :]
    index = json.loads((options.bench / "index.json").read_text())
    peers = json.loads((options.bench / "peers.json").read_text())
    options.out.mkdir(parents=True, exist_ok=True)
    truths = {entry["truth"] for name, entry in index.items() if re.search(options.only, name)}
    genus = {truth: true_genus(options.bench, truth) for truth in truths}
    classes = {}
    for name, entry in index.items():
        if re.search(options.only, name):
            classes.setdefault(entry["class"], []).append(name)
    figures, tables, rows = {}, [], []
    for title, names in classes.items():
        ours = []
        for name in names:
            ours.append(measure(options.bench, name, index[name], options.out, arguments))
            print(json.dumps(ours[-1]), file=sys.stderr, flush=True)
        genera = {name: genus[index[name]["truth"]] for name in names}
        figures[title] = ours
        rivals = peers_of(peers, names)
        tables.append(table(title, ours, rivals, genera))
        print(tables[-1], flush=True)
        done = [row["chamfer"] for row in ours if row["chamfer"] is not None]
        bare, given = ([means[0] for _, means in kind] for kind in by_normals(rivals))
        if done:
            rows.append((title, geometric_mean(done), bare, given))
    (options.out / "tables.md").write_text("\n".join(tables))
    if rows:
        (options.out / "chamfer.svg").write_text(picture(rows))
    (options.out / "figures.json").write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
