"""`load.R`: loads the tables of an export into R with factors, labels of variables and values, and
texts as they were typed, without any package.
"""

import json
from collections.abc import Iterable, Iterator, Sequence

from experiments.dataset.code_book import layouts
from experiments.dataset.columns import Column, declared
from experiments.dataset.files import questionnaire_paths, table_path
from experiments.dataset.records import TABLES
from experiments.export.format import ExportFormat, File, text_of

NUMBERS = frozenset({"states", "network"})  # tables with a file a session
# Columns of codes and words in whichever table: a code such as 12E5 is no number.
TEXTS = {one.name for kind in TABLES.values() for one in declared(kind) if one.is_text}


class RScriptFormat(ExportFormat):
    def of_study(self) -> Iterator[File]:
        dataset = self.source.dataset
        paths = questionnaire_paths(one.slug for one in dataset.questionnaires)
        files, columns = [], []
        for name, layout in layouts(dataset, self.source.more):
            if name not in NUMBERS:
                files.append((name, _quoted(paths.get(name) or table_path(name))))
                columns.append((name, _list(_columns(layout))))
        lists = f"dataset_files <- {_list(files)}\ndataset_columns <- {_list(columns)}\n"
        yield "load.R", [text_of("load.R"), lists]


def _columns(layout: Sequence[Column]) -> Iterator[tuple[str, str]]:
    for column in layout:
        about = [("label", _quoted(column.meaning))]
        if column.levels and not column.divider:
            levels = ((word, _quoted(meaning or word)) for word, meaning in column.levels.items())
            about.append(("levels", _list(levels, "c")))
        if column.name in TEXTS or column.divider:
            about.append(("text", "TRUE"))
        yield column.name, _list(about)


def _list(entries: Iterable[tuple[str, str]], kind: str = "list") -> str:
    return f"{kind}(" + ",\n".join(f"{_quoted(name)} = {value}" for name, value in entries) + ")"


def _quoted(text: str) -> str:
    """Return a literal of R, which has the escapes of JSON."""
    return json.dumps(text, ensure_ascii=False)
