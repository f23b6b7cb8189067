"""`load.R`: loads the tables of an export into R with factors, labels of variables and values, and
texts as they were typed. It needs no package.
"""

import json
from collections.abc import Iterable, Iterator, Sequence

from experiments.dataset.code_book import layouts
from experiments.dataset.columns import Column, declared
from experiments.dataset.names import questionnaire_paths, table_path
from experiments.dataset.records import TABLES
from experiments.export.format import ExportFormat, File

NUMBERS = frozenset({"states", "network"})  # tables with a file a session
# Columns of codes and words in whichever table: a code such as 12E5 is no number.
TEXTS = {one.name for kind in TABLES.values() for one in declared(kind) if one.is_text}
SCRIPT = r"""# Loads the tables of this dataset into R:
#
#     source("load.R", encoding = "UTF-8")
#     study <- load_dataset()           # from the working directory, or load_dataset("folder")
#     study$sessions$outcome            # a factor; attr(, "label") is what a column means
#     load_numbers("states", "CODE")    # the states of a session; "network" likewise
#
# In the files an apostrophe precedes what a spreadsheet would take for a formula: unguarded() takes
# it away. Empty cells are NA.

unguarded <- function(x) {
  gsub("(^ *|[;\t\r\n][ \"]*)'(?=['=+@\uFF1D\uFF0B\uFF0D\uFF20-])", "\\1", x, perl = TRUE)
}

load_column <- function(x, about) {
  x <- unguarded(x)
  x[x == ""] <- NA
  levels <- about$levels
  if (!is.null(levels) && !any(is.na(suppressWarnings(as.numeric(names(levels)))))) {
    x <- as.numeric(x)
    attr(x, "labels") <- setNames(as.numeric(names(levels)), levels)
  } else if (!is.null(levels)) {
    x <- factor(x, levels = union(names(levels), sort(unique(x))))
    attr(x, "labels") <- levels
  } else if (!isTRUE(about$text)) {
    x <- type.convert(x, as.is = TRUE, na.strings = c("NA", "nan"))
  }
  attr(x, "label") <- about$label
  x
}

load_dataset <- function(folder = ".") {
  found <- list()
  for (name in names(dataset_columns)) {
    file <- file.path(folder, dataset_files[[name]])
    if (!file.exists(file)) next
    table <- read.csv(file, colClasses = "character", check.names = FALSE,
                      na.strings = character(), encoding = "UTF-8")
    for (column in names(table)) {
      table[[column]] <- load_column(table[[column]], dataset_columns[[name]][[column]])
    }
    found[[name]] <- table
  }
  found
}

load_numbers <- function(name, session, folder = ".") {
  file <- paste0("session-", gsub("-", "", session), "_data.csv")
  read.csv(file.path(folder, "data", name, file), na.strings = "nan")
}

"""


class RScriptFormat(ExportFormat):
    """What every export has."""

    def of_study(self) -> Iterator[File]:
        """Yield the script."""
        dataset = self.source.dataset
        tables = {
            name: layout
            for name, layout in layouts(dataset, self.source.more)
            if name not in NUMBERS
        }
        paths = questionnaire_paths(one.slug for one in dataset.questionnaires)
        files = {name: paths.get(name) or table_path(name) for name in tables}
        columns = {name: _list(_columns(layout)) for name, layout in tables.items()}
        text = "\n".join(
            (
                f"dataset_files <- {_list((name, _quoted(path)) for name, path in files.items())}",
                f"dataset_columns <- {_list(columns.items())}",
            )
        )
        yield "load.R", [f"{SCRIPT}{text}\n".encode()]


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
    """Return a literal of R, whose escapes are those of JSON; other characters stand for
    themselves.
    """
    return json.dumps(text, ensure_ascii=False)
