"""The painter's tables, figures and claims: what was measured, with the paper's numbers beside it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from terrain.measure.reproduce import Cell, Claim, Plot, Table

MODES = ("wrong", "z-buffer", "correct")
Rates = dict[str, list[float]]  # frames per second of every variant, by depth

# Frames per second in tables 1 to 3: posts along one side, eye, mode, then depths from 0.
_TABLES = """
 512 static wrong    763 762 760 758 748 686 214  63  14
 512 static z-buffer 722 723 721 718 709 608 207  62  14
 512 static correct  744 744 744 739 728 610 177  51  13
 512 moving wrong    805 796 777 762 758 680 220  63  14
 512 moving z-buffer 738 720 716 712 714 642 221  63  14
 512 moving correct  517 742 753 749 750 636 179  51  13
1024 static wrong    249 250 250 242 238 239 207  49  16
1024 static z-buffer 237 239 239 236 233 234 198  48  16
1024 static correct  245 248 248 241 238 239 165  43  13
1024 moving wrong    244 245 245 238 234 233 207  48  16
1024 moving z-buffer 233 235 235 232 229 228 205  48  16
1024 moving correct  209 222 229 233 232 232 169  43  13
2048 static wrong     63  65  65  65  63  62  62  51
2048 static z-buffer  62  63  63  63  62  61  61  51
2048 static correct   55  60  65  65  63  62  62  45
2048 moving wrong     63  64  65  65  63  62  62  51
2048 moving z-buffer  61  62  63  63  62  61  62  51
2048 moving correct   41  52  58  59  62  62  62  43
"""


def _read_tables(text: str) -> dict[int, tuple[dict[str, tuple[int, ...]], dict[str, tuple[int, ...]]]]:
    """By posts along one side: for a static and for a moving eye, the rates of every mode."""
    tables: dict[int, tuple[dict[str, tuple[int, ...]], dict[str, tuple[int, ...]]]] = {}
    for line in text.strip().splitlines():
        posts, eye, mode, *rates = line.split()
        tables.setdefault(int(posts), ({}, {}))[eye == "moving"][mode] = tuple(map(int, rates))
    return tables


PAPER = _read_tables(_TABLES)
RANDOMNESS = (0, 25, 50, 75, 100)  # per cent
PAPER_RANDOMNESS = {512: (755, 640, 555, 495, 445), 1024: (245, 199, 165, 142, 121), 2048: (62, 51, 41, 35, 31)}


def depth_table(number: int, posts: int, depths: Sequence[int], rates: tuple[Rates, Rates]) -> Table:
    rows: list[list[Cell]] = []
    for eye, name in enumerate(("static", "moving")):
        for label, values in rates[eye].items():
            rows.append([name, label, *values])
            paper = PAPER[posts][eye].get(label) if posts in PAPER else None
            if paper is not None:
                rows.append([name, f"{label} (paper)", *(paper[d] for d in depths)])
    columns = ("eye", "order", *(f"depth {d} [fps]" for d in depths))
    return Table(
        f"table{number}", f"Table {number}: frames per second, {posts} x {posts} posts", columns, rows,
        "Paper: AMD Radeon HD6750M, 2011. The orders without a note come from index buffers, one call per tile.",
    )  # fmt: skip


def depth_plots(posts: int, depths: Sequence[int], rates: tuple[Rates, Rates]) -> Iterator[Plot]:
    for eye, (figure, name) in enumerate(((16, "static"), (20, "moving"))):
        series = {label: list(zip(depths, values, strict=True)) for label, values in rates[eye].items()}
        if posts in PAPER:
            series |= {
                f"{mode} (paper)": [(d, PAPER[posts][eye][mode][d]) for d in depths] for mode in MODES
            }  # fmt: skip
        title = f"Figure {figure}: {name} eye, {posts} x {posts} posts"
        yield Plot(f"figure{figure}_{posts}", title, "quadtree depth", "frames per second", series, log_y=True)


def randomness_table(shuffled: dict[int, list[float]]) -> Table:
    rows: list[list[Cell]] = []
    for posts, values in shuffled.items():
        rows.append([f"{posts} x {posts}", *values])
        if posts in PAPER_RANDOMNESS:
            rows.append([f"{posts} x {posts} (paper)", *PAPER_RANDOMNESS[posts]])
    columns = ("posts", *(f"{percent} % [fps]" for percent in RANDOMNESS))
    return Table("table4", "Table 4: frames per second by randomness of the indices", columns, rows)


def randomness_plots(shuffled: dict[int, list[float]]) -> Iterator[Plot]:
    for name, title, is_relative in (("figure18a", "Figure 18a", False), ("figure18b", "Figure 18b, relative", True)):
        series: dict[str, list[tuple[float, float]]] = {}
        for posts, ours in shuffled.items():
            for label, values in ((f"{posts}", ours), (f"{posts} (paper)", PAPER_RANDOMNESS.get(posts))):
                if values is not None:
                    base = values[0] if is_relative else 1.0
                    series[label] = [(float(r), v / base) for r, v in zip(RANDOMNESS, values, strict=True)]
        yield Plot(name, title, "randomness of the indices [%]", "frames per second", series, log_y=not is_relative)


def speed_claims(
    depths: Sequence[int], rates: dict[int, tuple[Rates, Rates]], fragments: dict[int, dict[str, float]]
) -> Iterator[Claim]:
    """What the paper says of speed; where a depth test is the faster way, the shading it saves says why."""

    def ratio(eye: int, over: str, under: str, chosen: Sequence[int]) -> list[float]:
        pairs = [
            (rates[posts][eye][over][i], rates[posts][eye][under][i])
            for posts in rates
            for i, depth in enumerate(depths[: len(rates[posts][eye][over])])
            if depth in chosen
        ]
        return [a / b for a, b in pairs]

    plateau = [d for d in depths if 3 <= d <= 6] or list(depths)
    for eye, name, chosen in ((0, "static eye, all depths", depths), (1, "moving eye, depths 3 to 6", plateau)):
        for suffix in ("", ", by number"):
            found = ratio(eye, f"correct{suffix}", f"z-buffer{suffix}", chosen)
            shaded = " against ".join(
                f"{np.mean([of_size[mode] for of_size in fragments.values()]):.2f}" for mode in ("correct", "z-buffer")
            )
            yield Claim(
                f"correct{suffix} against z-buffer{suffix}, {name}",
                "as fast" if eye == 0 else "as fast or faster",
                f"{min(found):.2f} to {max(found):.2f} times as fast, {np.mean(found):.2f} on average; "
                f"{shaded} fragments shaded per pixel",
                bool(np.mean(found) >= (0.97 if eye == 0 else 1.0)),
            )
    found = ratio(1, "correct", "wrong", plateau)
    papers = [np.divide(moving["correct"], moving["wrong"])[3:7].mean() for _, moving in PAPER.values()]
    yield Claim(
        "the order itself costs nothing: correct against wrong, moving eye, depths 3 to 6",
        f"{np.mean(papers):.2f} times as fast on average",
        f"{min(found):.2f} to {max(found):.2f} times as fast, {np.mean(found):.2f} on average",
        bool(np.mean(found) >= 0.95),
    )
    first = next(iter(rates))
    last, best = rates[first][1], {label: max(values) for label, values in rates[first][1].items()}
    drop = {label: best[label] / last[label][-1] for label in ("correct", "correct, by number")}
    deepest = depths[len(last["correct"]) - 1]
    yield Claim(
        f"index buffers drop at depth {deepest}, {first} x {first} posts", "57 times slower than at their best",
        f"{drop['correct']:.1f} times slower", drop["correct"] > 1.5,
    )  # fmt: skip
    yield Claim(
        f"the order by vertex number stays flat to depth {deepest}", "wished for in section 8",
        f"{drop['correct, by number']:.2f} times slower than at its best", drop["correct, by number"] < 1.5,
    )  # fmt: skip


def randomness_claim(shuffled: dict[int, list[float]]) -> Claim:
    found = [values[-1] / values[0] for values in shuffled.values()]
    return Claim(
        "random indices halve the frame rate", "0.49 to 0.59 of the rate of ordered ones",
        f"{min(found):.2f} to {max(found):.2f}", min(found) < 0.65,
    )  # fmt: skip


def depth_write_claim(found: dict[int, float]) -> Claim:
    return Claim(
        "writing depth, so that other things can be hidden, costs little", "not written",
        f"{100 * (min(found.values()) - 1):+.0f} to {100 * (max(found.values()) - 1):+.0f} % of the frame",
        max(found.values()) < 1.1,
    )  # fmt: skip
