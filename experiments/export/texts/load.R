# Loads the tables of this dataset into R:
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

