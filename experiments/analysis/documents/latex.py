"""Tables and sentences as LaTeX. A table needs the package booktabs and no other."""

import re
from collections.abc import Iterable, Sequence

from experiments.analysis.documents.typesetting import Run, head_runs, parts_of
from experiments.analysis.tables.table import Table

# Two hyphens would become a dash, and two quotation marks one.
_BETWEEN = "\0"
_LIGATURE = re.compile(r"([-'`])(?=\1)")
_GREEK = ("alpha", "beta", "epsilon", "eta", "mu", "rho", "sigma", "chi", "omega")
_LATEX = str.maketrans(
    {sign: rf"\{sign}" for sign in "&%$#_{}"}
    | dict.fromkeys("\n\r\t", " ")
    | {sign: rf"$\{name}$" for sign, name in zip("αβεημρσχω", _GREEK, strict=True)}
    | {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
    | {"|": r"\textbar{}", _BETWEEN: "{}", "\u00a0": "~", "…": r"\ldots{}"}
    | {"−": "$-$", "±": r"$\pm$", "≤": r"$\leq$", "≥": r"$\geq$", "<": "$<$", ">": "$>$"}
    | {"²": "$^2$", "×": r"$\times$", "·": r"$\cdot$", "√": r"$\surd$", "→": r"$\rightarrow$"}
    | {"–": "--", "—": "---", "“": "``", "”": "''", "‘": "`", "’": "'"}
)
_POSITIONS = {"sub": r"\textsubscript", "super": r"\textsuperscript"}
PREAMBLE = "% Needs \\usepackage{booktabs} in the preamble.\n"


def latex(text: str) -> str:
    """Return text that LaTeX prints literally, other alphabets unchanged (LaTeX reads UTF-8)."""
    return _LIGATURE.sub(lambda found: found[0] + _BETWEEN, text).translate(_LATEX)


def runs_as_latex(runs: Iterable[Run]) -> str:
    return "".join(_run(run) for run in runs)


def _run(run: Run) -> str:
    text = latex(run.text)
    if run.italic:
        text = rf"\textit{{{text}}}"
    return f"{_POSITIONS[run.position]}{{{text}}}" if run.position else text


def as_latex(table: Table) -> str:
    return PREAMBLE + "\n".join(_part(part) for part in parts_of(table))


def _part(table: Table) -> str:
    head = " & ".join(runs_as_latex(head_runs(name)) for name in table.head) + r" \\"
    columns = "".join("r" if is_numeric else "l" for is_numeric in table.are_numeric)
    lines = [
        r"\begin{table}",
        r"\centering",
        rf"\caption{{{latex(table.title)}}}",
        rf"\label{{tab:{table.name}}}",
        rf"\begin{{tabular}}{{{columns}}}",
        r"\toprule",
        head,
        r"\midrule",
        *(_line([cell.text for cell in row]) for row in table.rows),
        r"\bottomrule",
        r"\end{tabular}",
        *(rf"\par\smallskip {{\footnotesize {latex(note)}}}" for note in table.notes),
        r"\end{table}",
    ]
    return "\n".join(lines) + "\n"


def _line(cells: Sequence[str]) -> str:
    line = " & ".join(latex(cell) for cell in cells) + r" \\"
    # After a line break, these would be its argument.
    return f"{{}}{line}" if line.startswith(("[", "*")) else line
