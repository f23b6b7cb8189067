# What a stranger computes from an exported study alone, by the code book in its
# dataset_description.json: every statistic of the report that R has a function or a textbook
# formula for. It reads data/, questionnaires/ and study.json, and writes a CSV with
# table, row, column, value.
#
#   Rscript stranger.R DATASET KIND OUT.csv        (KIND: participant or bot)
#
# Debian: r-base-core r-cran-lme4 r-cran-survival r-cran-clubsandwich r-cran-jsonlite
suppressPackageStartupMessages({library(lme4); library(survival); library(clubSandwich); library(jsonlite)})
arguments <- commandArgs(TRUE)
folder <- arguments[1]; kind <- arguments[2]
csv <- function(...) read.csv(file.path(folder, "data", paste0(..., "_data.csv")), check.names = FALSE)
json <- function(...) fromJSON(file.path(folder, ...), simplifyVector = FALSE)

told <- new.env(); told$rows <- list()
tell <- function(.table, .row, ...) {
  found <- list(...)
  for (column in names(found))
    told$rows[[length(told$rows) + 1]] <- list(.table, .row, column, found[[column]])
}

# --- the data: sessions that count, and answers to them ------------------------------------------

study <- json("study.json")
people <- subset(csv("description-participants"), kind == get("kind", globalenv()) & withdrawn == 0)
conditions <- sapply(study$conditions, `[[`, "key")
# conditions that one participant may have: those with the same levels of the factors between participants
between <- Filter(function(key) is.character(key), lapply(study$factors, function(one) if (identical(one$design, "within")) NULL else one$key))
together <- sapply(study$conditions, function(one) paste(c("", unlist(one$levels[unlist(between)])), collapse = " "))
names(together) <- conditions
# a drive of the task counts when it has ended, moved, and neither platform nor researcher excludes it, in the
# cell of the participant's first one; these studies count all drives of a participant in a condition
driven <- subset(csv("description-sessions"), participant %in% people$id & practice == 0 & !(fault_side %in% "platform") &
  !(outcome %in% c("", NA)) & excluded %in% c("", NA) & !(is.na(first_frame) & is.na(first_motion)))
driven$moved <- !is.na(driven$first_motion)
of_first_cell <- function(own) subset(own, together[condition] == together[condition[match(participant, participant)]])
sessions <- of_first_cell(subset(driven, moved))
# success and times are also of who saw the video and never moved: the last such drive, where no drive counts
cell_of <- function(own) paste(own$participant, own$condition)
unmoved <- subset(driven, !moved & !(cell_of(driven) %in% cell_of(sessions)))
tried <- of_first_cell(rbind(sessions, unmoved[!duplicated(cell_of(unmoved), fromLast = TRUE), ]))
measured_of <- function(own) merge(own[c("id", "participant", "number", "visit", "condition", "robot", "outcome", "os", "browser", "moved")],
  csv("description-metrics"), by.x = "id", by.y = "session")
metrics <- measured_of(sessions); attempts <- measured_of(tried)
orders <- setNames(strsplit(people$cell, "-"), people$id)

asked <- list()
for (path in list.files(file.path(folder, "questionnaires"))) {
  one <- json("questionnaires", path); asked[[one$slug]] <- one
}
items_of <- function(one) unlist(lapply(one$pages, function(page) lapply(page$items, `[[`, "key")))
answers <- subset(csv("description-answers"), finished == 1 & session %in% sessions$id)
wide <- function(slug) {
  own <- answers[answers$questionnaire == slug, ]
  own$value <- suppressWarnings(as.numeric(own$value))
  found <- reshape(own[c("response", "participant", "session", "item", "value")], direction = "wide",
    idvar = c("response", "participant", "session"), timevar = "item")
  names(found) <- sub("^value[.]", "", names(found))
  found <- merge(found, sessions[c("id", "condition", "robot", "number")], by.x = "session", by.y = "id")
  found[order(found$participant, found$number), ]
}
# SUS: odd items count x - 1, even ones 5 - x; the sum times 2.5 (Brooke, 1996)
recoded <- function(slug, found) {
  one <- asked[[slug]]
  if (slug == "sus") for (n in 1:10) {
    key <- paste0("sus", n); found[[key]] <- if (n %% 2 == 1) found[[key]] - 1 else 5 - found[[key]]
  }
  for (page in one$pages) for (item in page$items) if (isTRUE(item$reverse)) {
    points <- sapply(one$scales[[item$scale]], `[[`, "value")
    found[[item$key]] <- max(points) + min(points) - found[[item$key]]
  }
  found
}
responses <- lapply(setNames(nm = intersect(names(asked), unique(answers$questionnaire))),
  function(slug) recoded(slug, wide(slug)))
topics_of <- function(slug) {
  found <- asked[[slug]]$topics
  setNames(lapply(found, function(topic) unlist(topic$items)), sapply(found, `[[`, "key"))
}
scales <- function(slug) {
  switch(asked[[slug]]$scoring,
    sus = list(overall = paste0("sus", 1:10)), tlx_raw = list(overall = items_of(asked[[slug]])),
    likert = c(list(overall = items_of(asked[[slug]])), topics_of(slug)), topics = topics_of(slug), list())
}
score <- function(slug, keys, found) {
  if (asked[[slug]]$scoring == "sus" && length(keys) == 10) 2.5 * rowSums(found[keys])
  else if (asked[[slug]]$scoring == "tlx_raw") rowMeans(found[keys])
  else { value <- rowMeans(found[keys], na.rm = TRUE); value[is.nan(value)] <- NA; value }
}
# a measure as participant, condition, value: the mean over a participant's sessions of a condition
measured <- function(name) {
  parts <- strsplit(name, ".", fixed = TRUE)[[1]]
  if (length(parts) == 1) {
    own <- data.frame(participant = metrics$participant, condition = metrics$condition, value = metrics[[name]])
  } else {
    found <- responses[[parts[1]]]
    keys <- scales(parts[1])[[parts[2]]]; if (is.null(keys)) keys <- parts[2]
    own <- data.frame(participant = found$participant, condition = found$condition,
      value = score(parts[1], keys, found))
  }
  own <- own[is.finite(own$value), ]
  if (nrow(own)) aggregate(value ~ participant + condition, own, mean) else own
}
by_condition <- function(name, keys = conditions) {
  own <- measured(name)
  lapply(setNames(nm = keys), function(key) with(own[own$condition == key, ], setNames(value, participant)))
}

# --- textbook statistics -------------------------------------------------------------------------

describe <- function(x, prefix = "", ordinal = FALSE) {
  found <- list(n = length(x), mean = mean(x), SD = sd(x))
  if (ordinal) found <- c(found, list(median = median(x), IQR = IQR(x)))
  setNames(found, paste0(prefix, names(found)))
}
same <- function(x) diff(range(x)) <= 1e-9 * max(abs(x), 0)
complete <- function(groups) {
  shared <- Reduce(intersect, lapply(groups, names)); do.call(cbind, lapply(groups, function(one) one[shared]))
}
d_z <- function(t, n) {  # the interval by the noncentral t distribution (Steiger and Fouladi, 1997)
  bound <- function(tail) uniroot(function(ncp) pt(t, n - 1, ncp) - tail, t + c(-9, 9), tol = 1e-12, extendInt = "yes")$root
  list(Size = t / sqrt(n), `Size: from` = suppressWarnings(bound(.975)) / sqrt(n),
    `Size: to` = suppressWarnings(bound(.025)) / sqrt(n))
}
paired_means <- function(x, y) {
  if (same(x - y)) return(list(`n tested` = length(x), Difference = mean(x - y)))
  found <- t.test(x, y, paired = TRUE)
  c(list(`n tested` = length(x), Statistic = found$statistic, df = found$parameter, p = found$p.value,
    Difference = mean(x - y), `Difference: from` = found$conf.int[1], `Difference: to` = found$conf.int[2]),
    d_z(unname(found$statistic), length(x)))
}
paired_ranks <- function(x, y) {  # Pratt (1959): pairs without a difference are ranked, and their ranks dropped
  difference <- round(x - y, 9); n <- length(difference); zeros <- sum(difference == 0)
  if (zeros == n) return(list(`n tested` = n, Difference = 0))
  ranks <- rank(abs(difference)); ranks[difference == 0] <- 0; at <- sum(ranks[difference > 0])
  given <- abs(difference[difference != 0]); ties <- table(given)
  if (!zeros && !anyDuplicated(given) && n <= 50) p <- wilcox.test(difference, exact = TRUE)$p.value
  else if (n <= 13) {  # every way to give signs to the ranks
    sums <- as.matrix(expand.grid(rep(list(0:1), n))) %*% ranks
    p <- min(1, 2 * min(mean(sums <= at + 1e-9), mean(sums >= at - 1e-9)))
  } else {
    spread <- (n * (n + 1) * (2 * n + 1) - zeros * (zeros + 1) * (2 * zeros + 1) - sum(ties^3 - ties) / 2) / 24
    p <- 2 * pnorm(-abs(at - (n * (n + 1) - zeros * (zeros + 1)) / 4) / sqrt(spread))
  }
  walsh <- outer(difference, difference, "+"); walsh <- sort(walsh[lower.tri(walsh, diag = TRUE)] / 2)
  place <- max(0, floor(n * (n + 1) / 4 - qnorm(.975) * sqrt(n * (n + 1) * (2 * n + 1) / 24)))
  list(`n tested` = n, Statistic = at, p = p, Difference = median(walsh),
    `Difference: from` = walsh[place + 1], `Difference: to` = walsh[length(walsh) - place], Size = 2 * at / sum(ranks) - 1)
}
friedman <- function(groups) {
  table <- round(complete(groups), 9); n <- nrow(table)
  if (all(table == table[, 1])) return(list(`n tested` = n))
  found <- friedman.test(table)
  list(`n tested` = n, Statistic = found$statistic, df = found$parameter, p = found$p.value,
    Size = unname(found$statistic) / (n * (ncol(table) - 1)))
}
repeated <- function(groups) {  # with the correction of Greenhouse and Geisser
  table <- complete(groups); n <- nrow(table); k <- ncol(table)
  if (all(apply(table - table[, 1], 2, same))) return(list(`n tested` = n))
  fit <- lm(table ~ 1); found <- anova(fit, X = ~1, test = "Spherical")
  epsilon <- stats:::sphericity(SSD(fit), X = ~1)$GG.eps
  f <- found[1, "F"]
  list(`n tested` = n, Statistic = f, df = epsilon * (k - 1), `df 2` = epsilon * (k - 1) * (n - 1), p = found[1, "G-G Pr"],
    Size = f / (f + n - 1))
}
mcnemar_mid <- function(x, y) {  # and the interval of Bonett and Price (2012)
  n <- length(x); b <- sum(x > y); c <- sum(y > x); p <- (b + 1) / (n + 2); q <- (c + 1) / (n + 2)
  slack <- qnorm(.975) * sqrt((p + q - (p - q)^2) / (n + 2))
  found <- list(`n tested` = n, Difference = (b - c) / n, `Difference: from` = max(-1, p - q - slack),
    `Difference: to` = min(1, p - q + slack))
  if (b + c) c(found, list(Statistic = b, p = min(1, 2 * pbinom(min(b, c), b + c, .5) - dbinom(min(b, c), b + c, .5)))) else found
}
pearson <- function(groups) {  # with N - 1 (Campbell, 2007), or Boschloo's exact test, and Newcombe's interval (1998)
  n <- lengths(groups); yes <- sapply(groups, sum); found <- list(`n tested` = sum(n))
  if (length(groups) == 2) {
    bounds <- mapply(function(k, n) prop.test(k, n, correct = FALSE)$conf.int, yes, n); p <- yes / n; away <- abs(bounds - rep(p, each = 2))
    found <- c(found, list(Difference = p[[1]] - p[[2]], `Difference: from` = p[[1]] - p[[2]] - sqrt(away[1, 1]^2 + away[2, 2]^2),
      `Difference: to` = p[[1]] - p[[2]] + sqrt(away[2, 1]^2 + away[1, 2]^2)))
  }
  if (sum(yes) %in% c(0, sum(n))) return(found)
  expected <- outer(c(sum(yes), sum(n - yes)) / sum(n), n)
  if (length(groups) == 2 && min(expected) < 1) return(c(found, boschloo(yes[[1]], n[[1]], yes[[2]], n[[2]])))
  chi2 <- (sum(n) - 1) / sum(n) * sum((rbind(yes, n - yes) - expected)^2 / expected)
  c(found, list(Statistic = chi2, df = length(n) - 1, p = pchisq(chi2, length(n) - 1, lower.tail = FALSE)))
}
boschloo <- function(a, n, b, m) {  # Fisher's p of each side is the statistic of an exact unconditional test
  tables <- expand.grid(x = 0:n, y = 0:m)
  one_sided <- function(lower) {
    fisher <- mapply(function(x, y) phyper(if (lower) x else x - 1, n, m, x + y, lower.tail = lower), tables$x, tables$y)
    at <- fisher[tables$x == a & tables$y == b]; as_extreme <- tables[fisher <= at * (1 + 1e-9), ]
    chance <- function(q) sum(dbinom(as_extreme$x, n, q) * dbinom(as_extreme$y, m, q))
    grid <- seq(0, 1, length.out = 2001); best <- grid[which.max(sapply(grid, chance))]
    top <- optimize(chance, pmin(1, pmax(0, best + c(-.001, .001))), maximum = TRUE, tol = 1e-12)$objective
    c(at, max(top, chance(best)))
  }
  sides <- cbind(one_sided(TRUE), one_sided(FALSE)); chosen <- sides[, which.min(sides[2, ])]
  list(Statistic = chosen[1], p = min(1, 2 * chosen[2]))
}
# how the design lays out participants on sides of conditions: on one side each, on all, or on some; and whether
# anybody has several conditions of one side
layout_of <- function(sides) {
  had <- sapply(unique(together), function(kind) sapply(sides, function(keys) sum(together[keys] == kind)))
  on <- colSums(had > 0)
  list(paired = any(on == length(sides)), apart = all(on <= 1), single = all(had <= 1))
}
first_of <- function(own) {  # one drive of a participant in a condition
  own <- own[order(own$participant, own$visit), ]; own[!duplicated(own[c("participant", "condition")]), ]
}
# tests of drives, by what the design makes of them: of different participants, of the same ones, or of some of both
compare_drives <- function(kind, own, layout) {
  own <- own[order(own$side), ]
  people <- tapply(own$participant, own$side, function(who) length(unique(who)))
  own <- own[own$side %in% names(people)[!is.na(people) & people > 1], ]; own$side <- droplevels(own$side)
  if (nlevels(own$side) < 2) return(list(`n tested` = 0))
  groups <- lapply(split(own, own$side), function(one) setNames(one$value, one$participant))
  if (kind == "times" && layout$apart && layout$single) return(log_rank(own))
  if (kind == "proportions" && layout$single && layout$apart) return(pearson(groups))
  if (kind != "proportions" || !layout$single || !layout$paired) return(clustered(kind, own))
  both <- complete(groups); if (nrow(both) < 2) return(list(`n tested` = nrow(both)))
  if (length(groups) > 2) friedman(groups) else mcnemar_mid(both[, 1], both[, 2])
}
log_rank <- function(own) {
  found <- survdiff(Surv(value, weight) ~ side, own); q <- nlevels(own$side) - 1
  test <- list(`n tested` = nrow(own), Statistic = found$chisq, df = q, p = pchisq(found$chisq, q, lower.tail = FALSE))
  ratio <- if (q == 1) clustered("times", own)
  c(test, ratio[grep("^Size", names(ratio))])
}
# the robust score test of some columns of a model, whose other columns are fitted: a list of F, df and df 2
score_test <- function(kind, own, x, at) {
  others <- setdiff(seq_len(ncol(x)), at); n <- length(unique(own$participant)); q <- length(at)
  if (n <= q + 1 || same(if (kind == "counts") own$value / own$weight else own$value)) return(list(`n tested` = n))
  if (kind == "times") {
    fitted <- rep(0, ncol(x))
    if (length(others)) {
      rest <- tryCatch(coxph(Surv(value, weight) ~ x[, others], own, ties = "breslow", control = EXACT), warning = function(w) NULL)
      if (is.null(rest)) return(list(`n tested` = n))  # others separate
      fitted[others] <- coef(rest)
    }
    fit <- suppressWarnings(coxph(Surv(value, weight) ~ x, own, ties = "breslow", init = fitted, control = coxph.control(iter.max = 0)))
    if (fit$nevent == 0) return(list(`n tested` = n))
    scores <- as.matrix(residuals(fit, "score")); information <- solve(fit$var)
    scores <- if (!length(others)) scores[, at, drop = FALSE] else
      scores[, at, drop = FALSE] - scores[, others, drop = FALSE] %*% solve(information[others, others], information[others, at])
  } else {
    x <- cbind(1, x); others <- c(1, others + 1); rest <- x[, others, drop = FALSE]; columns <- x[, at + 1, drop = FALSE]
    family <- if (kind == "counts") poisson() else binomial()
    fit <- glm(value ~ rest - 1, family, own, offset = if (kind == "counts") log(own$weight), epsilon = 1e-12)
    w <- family$variance(fitted(fit)); if (min(w) < 1e-6 * max(w)) return(list(`n tested` = n))  # others separate
    explained <- rest %*% solve(crossprod(rest, w * rest), crossprod(rest, w * columns))
    scores <- (columns - explained) * (own$value - fitted(fit))
  }
  summed <- rowsum(scores, own$participant); summed[abs(summed) <= 1e-9 * max(abs(scores))] <- 0; covariance <- cov(summed)
  if (qr(covariance)$rank < q) return(list(`n tested` = n))
  f <- drop(colMeans(summed) %*% solve(covariance, colMeans(summed))) * n * (n - q) / (q * (n - 1))
  list(`n tested` = n, Statistic = f, df = q, `df 2` = n - q, p = pf(f, q, n - q, lower.tail = FALSE))
}
EXACT <- coxph.control(eps = 1e-12, toler.chol = 1e-13, toler.inf = 1e-9, iter.max = 100)
# coefficients of a model and their errors by participants; NULL where the data separate
coefficients_of <- function(kind, own, x) {
  n <- length(unique(own$participant))
  if (kind == "times") {
    fit <- tryCatch(coxph(Surv(value, weight) ~ x + cluster(participant), own, ties = "breslow", control = EXACT),
      warning = function(w) NULL)  # an estimate runs to infinity
    if (is.null(fit)) return(NULL)
    found <- list(b = -coef(fit), error = sqrt(diag(vcov(fit)) * n / (n - 1)), df = n - 1 - ncol(x))
  } else {
    fit <- suppressWarnings(glm(value ~ x, if (kind == "counts") poisson() else binomial(), own, offset = if (kind == "counts") log(own$weight), epsilon = 1e-12, maxit = 50))
    if (any(abs(coef(fit)) > 12)) return(NULL)
    found <- list(b = coef(fit), error = sqrt(diag(vcovCR(fit, cluster = own$participant, type = "CR3"))), df = n - 1 - ncol(x))
  }
  if (isTRUE(all(c(abs(found$b), found$error) <= 12))) found
}
# the score test of sides whose drives of one participant are a cluster, and of two the ratio between them
clustered <- function(kind, own) {
  own$side <- droplevels(own$side); contrasts(own$side) <- contr.sum(nlevels(own$side))
  x <- model.matrix(~ side, own)[, -1, drop = FALSE]; found <- score_test(kind, own, x, seq_len(ncol(x)))
  fit <- if (ncol(x) == 1) coefficients_of(kind, own, x)
  if (is.null(fit)) return(found)
  b <- tail(fit$b, 1); slack <- qt(.975, fit$df) * tail(fit$error, 1)
  c(found, list(Size = exp(2 * b), `Size: from` = exp(2 * (b - slack)), `Size: to` = exp(2 * (b + slack))))
}
of_some <- function(groups) {  # participants have only some of the conditions: a mixed model, tested by CR2 and HTZ
  own <- do.call(rbind, lapply(names(groups), function(key) data.frame(side = key, who = names(groups[[key]]), value = groups[[key]])))
  own$side <- factor(own$side, names(groups)); contrasts(own$side) <- contr.sum(nlevels(own$side)); n <- length(unique(own$who))
  if (all(tapply(own$value, own$who, same))) return(list(`n tested` = n))
  fit <- suppressWarnings(suppressMessages(lmer(value ~ side + (1 | who), own, control = lmerControl(optimizer = "bobyqa", optCtrl = list(rhoend = 1e-11)))))
  robust <- vcovCR(fit, cluster = own$who, type = "CR2")
  found <- Wald_test(fit, constraints = constrain_zero(seq_along(fixef(fit))[-1]), vcov = robust, test = "HTZ")
  row <- list(`n tested` = n, Statistic = found$Fstat, df = length(groups) - 1, `df 2` = found$df_denom, p = found$p_val)
  if (length(groups) > 2) return(row)
  b <- fixef(fit)[[2]]; slack <- qt(.975, found$df_denom) * sqrt(robust[2, 2])
  c(row, list(Difference = 2 * b, `Difference: from` = 2 * (b - slack), `Difference: to` = 2 * (b + slack)))
}
compared <- function(groups, test, layout = list(paired = TRUE)) {  # a condition of fewer than two participants is left out
  groups <- groups[lengths(groups) > 1]; if (length(groups) < 2) return(list(`n tested` = 0))
  if (!layout$paired) return(of_some(groups))
  both <- complete(groups); if (nrow(both) < 2) return(list(`n tested` = nrow(both)))
  if (length(groups) > 2) (if (test == "ranks") friedman else repeated)(groups)
  else (if (test == "ranks") paired_ranks else paired_means)(both[, 1], both[, 2])
}
# p values of a table by Holm's method, in which rows of the same data are one test
tell_family <- function(table, found, data) {
  ps <- sapply(found, function(one) if (is.null(one$p)) NA else one$p)
  codes <- sapply(data, function(one) paste(deparse(lapply(one, function(x) round(if (is.null(names(x))) x else x[order(names(x))], 9))), collapse = ""))
  first <- !duplicated(codes) & !is.na(ps); adjusted <- rep(NA, length(ps)); adjusted[first] <- p.adjust(ps[first], "holm")
  for (n in seq_along(found)) {
    known <- if (is.na(ps[n])) list() else list(`p (Holm)` = adjusted[first][match(codes[n], codes[first])])
    do.call(tell, c(list(table, names(found)[n]), found[[n]], known))
  }
}
compare_table <- function(table, measures, labels, ordinal, keys = conditions, test = "means") {
  groups <- lapply(measures, by_condition, keys = keys)
  for (n in seq_along(measures)) for (key in keys)
    do.call(tell, c(list(table, labels[n]), describe(groups[[n]][[key]], paste0(key, ": "), ordinal)))
  tell_family(table, setNames(lapply(groups, compared, test, layout_of(as.list(keys))), labels), groups)
}

# --- tables by condition -------------------------------------------------------------------------

compared_metrics <- c("completed", "task_time", "time_to_motion", "docking_time", "path", "efficiency",
  "speed", "stops", "collisions", "near_seconds")
kinds <- c(completed = "proportions", task_time = "times", time_to_motion = "times", stops = "counts", collisions = "counts")
per_minute <- c("stops", "collisions", "near_seconds"); of_completed <- "path"
label_of <- function(name) if (name %in% per_minute) paste(name, "per min") else if (name %in% of_completed) paste(name, "(completed)") else name
minutes <- function(own) own$total_time * own$seen / 60
# a metric as it may be compared between sessions of unequal length
comparable <- function(own, name) {
  value <- own[[name]]
  if (name %in% per_minute) ifelse(minutes(own) > 0, value / minutes(own), NA)
  else if (name %in% of_completed) ifelse(own$outcome == "completed", value, NA) else value
}
drives_of <- function(own, name, kind) {
  found <- data.frame(participant = own$participant, side = own$side, value = own[[name]], weight = 1)
  if (kind == "counts") { found$weight <- minutes(own); found <- found[is.finite(found$value) & is.finite(found$weight) & found$weight > 0, ] }
  if (kind == "times") {
    never <- !is.finite(found$value); found$value[never] <- own$total_time[never]; found$weight[never] <- 0
  }
  found[is.finite(found$value), ]
}
named_mean <- function(value, who) { known <- is.finite(value); found <- tapply(value[known], who[known], mean); found[!is.na(found)] }
# the drives of each side: a mean a participant, and what is told of them, of times the median by Kaplan and Meier
groups_of <- function(drives, kind) lapply(split(drives, drives$side), function(one)
  named_mean(if (kind == "counts") one$value / one$weight else one$value, one$participant))
tell_sides <- function(table, row, drives, kind) for (key in levels(drives$side)) {
  numbers <- describe(groups_of(drives, kind)[[key]], paste0(key, ": "), TRUE)
  if (kind == "times") {
    one <- drives[drives$side == key, ]; numbers <- numbers[1]
    if (any(one$weight > 0)) numbers[[paste0(key, ": median")]] <- summary(survfit(Surv(value, weight) ~ 1, one))$table[["median"]]
  }
  do.call(tell, c(list(table, row), numbers))
}
# a table of metrics between sides of sessions, by what kind of number each is
metrics_table <- function(table, own, names, layout) {
  found <- list(); data <- list(); keys <- levels(own$side); attempts <- own
  for (name in names) {
    kind <- if (name %in% names(kinds)) kinds[[name]] else "means"; row <- label_of(name)
    own <- if (kind %in% c("proportions", "times")) do.call(rbind, lapply(split(attempts, attempts$side), first_of)) else subset(attempts, moved)
    drives <- if (kind != "means") drives_of(own, name, kind)
    if (kind == "means") {
      groups <- lapply(setNames(nm = keys), function(key) { one <- own[own$side == key, ]; named_mean(comparable(one, name), one$participant) })
      for (key in keys) do.call(tell, c(list(table, row), describe(groups[[key]], paste0(key, ": "), TRUE)))
    } else { groups <- groups_of(drives, kind); tell_sides(table, row, drives, kind) }
    found[[row]] <- if (kind == "means") compared(groups, "means", layout) else compare_drives(kind, drives, layout)
    data[[row]] <- groups
  }
  tell_family(table, found, data)
}
attempts$side <- factor(attempts$condition, levels = conditions)
metrics_table("conditions", attempts, compared_metrics, layout_of(as.list(conditions)))

title_of <- function(slug, key) {
  for (topic in asked[[slug]]$topics) if (topic$key == key) return(topic$text$en)
  if (key == "overall") return(switch(asked[[slug]]$scoring, sus = "SUS", tlx_raw = "Raw TLX", "Overall"))
  for (page in asked[[slug]]$pages) for (item in page$items) if (item$key == key) return(item$text$en)
}
ends_of <- function(slug, keys) {  # what the score can be
  if (asked[[slug]]$scoring %in% c("sus", "tlx_raw")) return(c(0, 100))
  for (page in asked[[slug]]$pages) for (item in page$items) if (item$key %in% keys)
    return(range(sapply(asked[[slug]]$scales[[item$scale]], `[[`, "value")))
}
half_width <- function(x, level) qt(.5 + level / 2, length(x) - 1) * sd(x) / sqrt(length(x))
for (slug in names(responses)) {
  scored <- scales(slug)
  if (asked[[slug]]$scoring == "tlx_raw") for (key in items_of(asked[[slug]])) scored[[key]] <- key
  if (!length(scored)) next
  measures <- paste0(slug, ".", names(scored)); labels <- sapply(names(scored), title_of, slug = slug)
  for (n in seq_along(measures)) for (key in conditions) {
    ends <- ends_of(slug, scored[[n]]); x <- by_condition(measures[n])[[key]]; slack <- half_width(x, .95)
    tell(paste0("scores-", slug), paste(labels[n], key, "giraff", sep = "|"), n = length(x), Mean = mean(x),
      SD = sd(x), `CI95: from` = mean(x) - slack, `CI95: to` = mean(x) + slack, Median = median(x), IQR = IQR(x), Least = ends[1], Greatest = ends[2])
  }
  if (slug != "experience") compare_table(paste0("score-tests-", slug), measures, labels, TRUE)
}

# the statements of Table 5: percentages of all answers, the rest of a mean of each participant's responses
statements <- c(scales("experience"), setNames(nm = items_of(asked$experience)))
labels <- sapply(names(statements), function(key) if (key %in% items_of(asked$experience)) toupper(key) else title_of("experience", key))
compare_table("answers", paste0("experience.", names(statements)), labels, TRUE)
table_5 <- function(name, found) for (n in seq_along(statements)) {
  given <- unlist(found[statements[[n]]]); given <- given[!is.na(given)]
  x <- named_mean(score("experience", statements[[n]], found), found$participant)
  share <- setNames(as.list(100 * tabulate(given + 3, 5) / length(given)), paste("%", c("−2", "−1", "0", "+1", "+2")))
  do.call(tell, c(list(name, labels[n]), share, n = length(x), Mean = mean(x), SD = sd(x),
    CI95 = half_width(x, .95), CI99 = half_width(x, .99), Median = median(x), IQR = IQR(x)))
}
table_5("table-5", responses$experience)
for (key in conditions) table_5(paste0("table-5-", key), subset(responses$experience, condition == key))

# --- reliability: Cronbach's alpha with Feldt's interval, McDonald's omega with the delta method --

omega_of <- function(parameters, k) {
  common <- sum(parameters[1:k])^2; common / (common + sum(parameters[k + 1:k]))
}
one_factor <- function(x) {  # loadings and variances of their own, by maximum likelihood
  k <- ncol(x)
  if (k == 3) {  # three covariances give three loadings
    s <- cov(x); l <- sqrt(c(s[1, 2] * s[1, 3] / s[2, 3], s[1, 2] * s[2, 3] / s[1, 3], s[1, 3] * s[2, 3] / s[1, 2]))
    if (all(s > 0) && all(diag(s) - l^2 > .0051 * diag(s))) return(list(loadings = l, own = diag(s) - l^2))
  }
  fit <- tryCatch(factanal(x, 1, rotation = "none",
    control = list(lower = .005, nstart = 5, opt = list(factr = 10, maxit = 1000))), error = function(e) NULL)
  if (is.null(fit)) return(NULL)
  loadings <- fit$loadings[, 1] * apply(x, 2, sd)
  list(loadings = if (sum(loadings) < 0) -loadings else loadings, own = fit$uniquenesses * apply(x, 2, var))
}
for (slug in names(responses)) for (name in names(scales(slug))) for (key in conditions) {
  keys <- scales(slug)[[name]]; k <- length(keys); if (k < 2) next
  x <- as.matrix(na.omit(subset(responses[[slug]], condition == key)[keys])); n <- nrow(x)
  alpha <- k / (k - 1) * (1 - sum(apply(x, 2, var)) / var(rowSums(x)))
  row <- paste(slug, title_of(slug, name), key, "giraff", sep = "|")
  tell("reliability", row, Items = k, n = n, `α` = alpha,
    `α: from` = 1 - (1 - alpha) * qf(.975, n - 1, (n - 1) * (k - 1)),
    `α: to` = 1 - (1 - alpha) * qf(.025, n - 1, (n - 1) * (k - 1)))
  if (k < 3) next
  fit <- one_factor(x); if (is.null(fit)) next
  loadings <- fit$loadings; own <- fit$own; parameters <- c(loadings, own); omega <- omega_of(parameters, k)
  tell("reliability", row, `ω` = omega)
  if (any(own < .0051 * apply(x, 2, var))) next
  inverse <- solve(tcrossprod(loadings) + diag(own))
  slopes <- lapply(1:(2 * k), function(p) {
    change <- matrix(0, k, k)
    if (p <= k) { change[p, ] <- loadings; change[, p] <- change[, p] + loadings } else change[p - k, p - k] <- 1
    inverse %*% change
  })
  information <- outer(1:(2 * k), 1:(2 * k), Vectorize(function(i, j) n / 2 * sum(slopes[[i]] * t(slopes[[j]]))))
  gradient <- sapply(1:(2 * k), function(p) {
    step <- 1e-6 * pmax(1, abs(parameters[p])); up <- down <- parameters; up[p] <- up[p] + step; down[p] <- down[p] - step
    (omega_of(up, k) - omega_of(down, k)) / (2 * step)
  })
  error <- sqrt(drop(gradient %*% solve(information, gradient))) / (omega * (1 - omega))
  tell("reliability", row, `ω: from` = plogis(qlogis(omega) - qnorm(.975) * error),
    `ω: to` = plogis(qlogis(omega) + qnorm(.975) * error))
}

# --- driving: spreads, outcomes, the network, what is learnt -------------------------------------

for (name in names(csv("description-metrics"))[-(1:3)]) {
  x <- metrics[[name]]; x <- x[is.finite(x)]
  tell("metrics", name, n = length(x))
  if (length(x)) tell("metrics", name, Mean = mean(x), p5 = quantile(x, .05), Median = median(x),
    p95 = quantile(x, .95), IQR = IQR(x))
  if (length(x) > 1) tell("metrics", name, SD = sd(x))
}
wilson <- function(k, n) as.list(100 * prop.test(k, n, correct = FALSE)$conf.int)
once <- first_of(tried)
for (key in c(conditions, "all")) {
  own <- if (key == "all") once else once[once$condition == key, ]
  done <- sum(own$outcome == "completed")
  bounds <- if (anyDuplicated(own$participant)) list(NA, NA) else suppressWarnings(wilson(done, nrow(own)))
  counts <- as.list(table(factor(gsub("_", " ", own$outcome), gsub("_", " ", unique(once$outcome)))))
  do.call(tell, c(list("outcomes", key, Participants = length(unique(own$participant)), Sessions = nrow(own),
    `% completed` = 100 * done / nrow(own), from = bounds[[1]], to = bounds[[2]]), counts))
}
mean_of <- function(name) named_mean(comparable(metrics, name), metrics$participant)
causes <- c("round_trip", "loss", "command_age", "frame_age", "fps")
pairs <- expand.grid(driving = compared_metrics, network = causes, stringsAsFactors = FALSE)
correlations <- lapply(seq_len(nrow(pairs)), function(n) {
  x <- mean_of(pairs$network[n]); y <- mean_of(pairs$driving[n]); shared <- intersect(names(x), names(y))
  list(x = x[shared], y = y[shared])
})
spearman <- lapply(correlations, function(one) {
  n <- length(one$x); found <- list(`n tested` = n)
  if (n < 4 || same(one$x) || same(one$y)) return(found)
  rho <- cor(rank(signif(one$x, 11)), rank(signif(one$y, 11))); t <- rho * sqrt((n - 2) / (1 - rho^2))
  slack <- qnorm(.975) * sqrt((1 + rho^2 / 2) / (n - 3))  # Bonett and Wright (2000)
  c(found, list(Statistic = rho, df = n - 2, p = 2 * pt(-abs(t), n - 2), Size = rho,
    `Size: from` = tanh(atanh(rho) - slack), `Size: to` = tanh(atanh(rho) + slack)))
})
names(spearman) <- paste(pairs$network, sapply(pairs$driving, label_of), sep = "|")
tell_family("network-effects", spearman, correlations)

learnt <- c("task_time", "efficiency", "speed", "stops", "near_seconds", "collisions")
class_row <- function(table, row, own) {
  if (!nrow(own)) return(tell(table, row, Participants = 0, Sessions = 0))
  medians <- setNames(lapply(learnt, function(name) median(comparable(own, name), na.rm = TRUE)), paste0(sapply(learnt, label_of), ", median"))
  do.call(tell, c(list(table, row, Participants = length(unique(own$participant)), Sessions = nrow(own),
    `% completed` = 100 * mean(own$outcome == "completed")), medians[!is.na(medians)]))
}
edges <- list(round_trip = c(.05, .1, .2, .4), loss = c(.001, .01, .05), command_age = c(.05, .1, .2, .4),
  frame_age = c(.1, .2, .4, 1), fps = c(5, 10, 15, 25))
for (cause in causes) {
  at <- c(-Inf, edges[[cause]], Inf)
  for (n in seq_len(length(at) - 1)) {
    label <- if (n == 1) paste("<", at[2]) else if (n == length(at) - 1) paste("≥", at[n]) else paste(at[n], "–", at[n + 1])
    class_row("network-classes", paste(cause, label, sep = "|"), metrics[metrics[[cause]] >= at[n] & metrics[[cause]] < at[n + 1] & !is.na(metrics[[cause]]), ])
  }
}
for (way in c("datachannel", "mqtt"))
  class_row("network-classes", paste("control way", way, sep = "|"), metrics[which(metrics[[paste0("share_", way)]] > .5), ])
# visits of a participant in order, and what was driven on the first two of them
metrics$turn <- ave(metrics$visit, metrics$participant, FUN = function(visit) match(visit, sort(unique(visit))))
for (turn in sort(unique(metrics$turn)))
  class_row("learning", paste("visit", turn, sep = "|"), metrics[metrics$turn == turn, ])
cells <- paste(metrics$participant, metrics$condition)
again <- metrics[cells %in% intersect(cells[metrics$turn == 1], cells[metrics$turn == 2]) & metrics$turn %in% 1:2, ]
if (!nrow(again)) {
  for (name in c("completed", learnt)) tell("learning-tests", label_of(name), `second: n` = 0, `first: n` = 0, `n tested` = 0)
} else {
  again$side <- factor(ifelse(again$turn == 2, "second", "first"), levels = c("second", "first"))
  metrics_table("learning-tests", again, c("completed", learnt), list(paired = TRUE, apart = FALSE, single = !anyDuplicated(together)))
}

middle <- function(own, name) { x <- own[[name]]; if (all(is.na(x))) NULL else median(x, na.rm = TRUE) }
for (condition in study$conditions) {
  own <- metrics[metrics$condition == condition$key, ]
  seen <- list(`Command` = c("command_age_median", "command_age_p95"), `Video on the page` = c("frame_age", "frame_age_p95"),
    `Video at the wheels` = c("answer_age", "answer_age_p95"))
  row <- paste(condition$key, "clean", "clean", sep = "|")
  tell("ages", row, Participants = length(unique(own$participant)), Sessions = nrow(own))
  for (name in names(seen)) for (n in 1:2) {
    value <- middle(own, seen[[name]][n]); if (is.null(value)) next
    do.call(tell, c(list("ages", row), setNames(list(value), paste0(name, ", ", c("median", "p95")[n]))))
  }
  average <- function(name) { x <- own[[name]]; if (all(is.na(x))) NULL else mean(x, na.rm = TRUE) }
  do.call(tell, Filter(Negate(is.null), list("safety-limits", condition$key, Sessions = nrow(own), Commands = sum(own$commands, na.rm = TRUE),
    `% refused` = 100 * average("share_refused"), `% too old` = 100 * average("share_too_old"),
    `% slowed` = if (is.null(average("share_slowed"))) NULL else 100 * average("share_slowed"),
    `Asked (m/s)` = average("asked_speed"), `Allowed (m/s)` = average("allowed_speed"), `Applied (m/s)` = average("applied_speed"),
    `Command age (s)` = average("command_age_median"), `Command age, p95 (s)` = average("command_age_p95"))))
}

# --- the declared analyses -----------------------------------------------------------------------

levels_of <- function(name) {
  for (factor in study$factors) if (factor$key == name) return(sapply(factor$levels, `[[`, "key"))
  if (name == "condition") return(conditions)
  as.character(seq_along(conditions))  # period
}
long <- function(measure) {
  own <- measured(measure)
  for (factor in study$factors) {
    level <- sapply(study$conditions, function(one) one$levels[[factor$key]])
    own[[factor$key]] <- level[match(own$condition, conditions)]
  }
  own$period <- mapply(function(who, key) match(key, orders[[who]]), own$participant, own$condition)
  own
}
ours <- function(names, keys, sums) {  # R's names of coefficients as ours: period1 is "period 1"
  for (key in keys) {
    own <- levels_of(key); own <- if (sums) head(own, -1) else own[-1]
    for (n in seq_along(own)) names <- gsub(paste0("\\b", key, if (sums) n else own[n], "\\b"), paste(key, own[n]), names)
  }
  sub("(Intercept)", "(intercept)", names, fixed = TRUE)
}
contrast_table <- function(table, one, measures, own, test) {
  found <- list(); data <- list()
  for (measure in measures) for (side in one$contrasts) {
    drives <- drives_of(if (test == "counts") own else first_of(own), measure, test); row <- paste(measure, side$title$en, sep = "|")
    drives$side <- factor(ifelse(drives$side %in% unlist(side$first), "first", ifelse(drives$side %in% unlist(side$second), "second", NA)))
    drives <- drives[!is.na(drives$side), ]; tell_sides(table, row, drives, test)
    found[[row]] <- compare_drives(test, drives, layout_of(list(unlist(side$first), unlist(side$second)))); data[[row]] <- groups_of(drives, test)
  }
  tell_family(table, found, data)
}
model_table <- function(table, one, measures, own, test) {
  effects <- unlist(one$effects); keys <- unique(unlist(strsplit(effects, ":"))); family <- list()
  for (measure in measures) {
    drives <- drives_of(own, measure, test); formula <- as.formula(paste("~", paste(effects, collapse = " + ")))
    for (key in keys) {
      level <- sapply(study$conditions, function(one) one$levels[[key]])
      drives[[key]] <- factor(level[match(drives$side, conditions)], levels = levels_of(key))
      contrasts(drives[[key]]) <- contr.sum(nlevels(drives[[key]]))
    }
    matrix <- model.matrix(formula, drives); assigned <- attr(matrix, "assign")[-1]; x <- matrix[, -1, drop = FALSE]
    fit <- coefficients_of(test, drives, x); names <- ours(if (test == "times") colnames(x) else colnames(matrix), keys, TRUE)
    for (n in seq_along(fit$b)) {
      slack <- qt(.975, fit$df) * fit$error[n]; t <- fit$b[[n]] / fit$error[[n]]
      tell(paste0(table, "-coefficients"), paste(measure, names[n], sep = "|"), Estimate = fit$b[[n]], from = fit$b[[n]] - slack,
        to = fit$b[[n]] + slack, SE = fit$error[[n]], t = t, df = fit$df, p = 2 * pt(-abs(t), fit$df))
    }
    terms <- attr(terms(formula), "term.labels")
    for (n in seq_along(terms)) {
      at <- which(assigned == n); tested <- score_test(test, drives, x, at)
      row <- c(list(Participants = tested[[1]], Observations = nrow(drives)), tested[-1])
      if (length(fit$b) && length(at) == 1 && !grepl(":", terms[n])) {  # first less second level
        place <- at + length(fit$b) - ncol(x); slack <- qt(.975, fit$df) * fit$error[[place]]; b <- fit$b[[place]]
        row <- c(row, list(Difference = 2 * b, `Difference: from` = 2 * (b - slack), `Difference: to` = 2 * (b + slack)))
      }
      family[[paste(measure, terms[n], sep = "|")]] <- row
    }
  }
  adjusted <- p.adjust(sapply(family, function(one) if (is.null(one$p)) NA else one$p), "holm")
  for (n in seq_along(family)) do.call(tell, c(list(table, names(family)[n]), family[[n]], `p (Holm)` = adjusted[[n]]))
}
for (one in study$analyses) {
  table <- paste0("analysis-", gsub("_", "-", one$key)); measures <- unlist(one$measures)
  test <- if (is.null(one$test)) "means" else one$test
  if (test %in% c("proportions", "counts", "times")) {
    own <- attempts; own$side <- own$condition; if (test == "counts") own <- subset(own, moved)
    (if (length(one$effects)) model_table else contrast_table)(table, one, measures, own, test)
  } else if (test == "mixed") {
    effects <- unlist(one$effects); keys <- unique(unlist(strsplit(effects, ":"))); sums <- identical(one$coding, "sum")
    family <- list()
    for (measure in measures) {
      own <- long(measure); right <- paste(effects, collapse = " + ")
      coded <- function(own, sums) {
        for (key in keys) {
          own[[key]] <- factor(own[[key]], levels = levels_of(key))
          contrasts(own[[key]]) <- if (sums) contr.sum(nlevels(own[[key]])) else contr.treatment(levels(own[[key]]))
        }
        suppressMessages(lmer(as.formula(paste("value ~", right, "+ (1 | participant)")), own,
          control = lmerControl(optimizer = "bobyqa", optCtrl = list(rhoend = 1e-11))))
      }
      fit <- coded(own, sums); estimates <- fixef(fit)
      tests <- coef_test(fit, vcov = vcovCR(fit, cluster = own$participant, type = "CR2"), test = "Satterthwaite")
      named <- ours(names(estimates), keys, sums); degrees <- tests[[grep("^df", names(tests))[1]]]
      for (n in seq_along(estimates)) {
        value <- estimates[[n]]; error <- tests$SE[n]; df <- degrees[n]; slack <- qt(.975, df) * error
        tell(paste0(table, "-coefficients"), paste(measure, named[n], sep = "|"), Estimate = value,
          from = value - slack, to = value + slack, SE = error, t = value / error, df = df, p = 2 * pt(-abs(value / error), df))
      }
      spread <- as.data.frame(VarCorr(fit))$sdcor
      for (n in 1:3) tell(paste0(table, "-coefficients"), paste(measure, c("SD participants", "SD residual", "ICC")[n], sep = "|"),
        Estimate = c(spread, spread[1]^2 / sum(spread^2))[n])
      fit <- coded(own, TRUE)  # terms are tested in sum coding, whatever is printed
      covariance <- vcovCR(fit, cluster = own$participant, type = "CR2"); assigned <- attr(model.matrix(fit), "assign")
      tests <- coef_test(fit, vcov = covariance, test = "Satterthwaite"); degrees <- tests[[grep("^df", names(tests))[1]]]
      terms <- attr(terms(fit), "term.labels")
      for (n in seq_along(terms)) {
        at <- which(assigned == n); found <- Wald_test(fit, constraints = constrain_zero(at), vcov = covariance, test = "HTZ")
        row <- list(Participants = length(unique(own$participant)), Observations = nrow(own), Statistic = found$Fstat,
          df = length(at), `df 2` = found$df_denom, p = found$p_val)
        if (length(at) == 1 && !grepl(":", terms[n])) {  # first less second level
          slack <- qt(.975, degrees[at]) * tests$SE[at]
          row <- c(row, list(Difference = 2 * fixef(fit)[[at]], `Difference: from` = 2 * (fixef(fit)[[at]] - slack),
            `Difference: to` = 2 * (fixef(fit)[[at]] + slack)))
        }
        family[[paste(measure, terms[n], sep = "|")]] <- row
      }
    }
    adjusted <- p.adjust(sapply(family, `[[`, "p"), "holm")
    for (n in seq_along(family)) do.call(tell, c(list(table, names(family)[n]), family[[n]], `p (Holm)` = adjusted[[n]]))
  } else {
    sides <- lapply(one$contrasts, function(it) list(title = it$title$en, first = unlist(it$first), second = unlist(it$second)))
    if (!length(sides)) {
      tell_family(table, setNames(lapply(measures, function(it) compared(by_condition(it), test)), paste(measures, "all", sep = "|")),
        lapply(measures, by_condition))
      if (isTRUE(one$post_hoc)) sides <- combn(conditions, 2, simplify = FALSE,
        FUN = function(two) list(title = paste(two[1], "−", two[2]), first = two[1], second = two[2]))
    }
    found <- list(); data <- list()
    for (measure in measures) for (side in sides) {
      averaged <- function(keys) { both <- complete(by_condition(measure, keys)); setNames(rowMeans(as.matrix(both)), rownames(both)) }
      groups <- list(first = averaged(side$first), second = averaged(side$second)); row <- paste(measure, side$title, sep = "|")
      for (name in names(groups)) do.call(tell, c(list(table, row), describe(groups[[name]], paste0(name, ": "), TRUE)))
      found[[row]] <- compared(groups, test); data[[row]] <- groups
    }
    if (length(found)) tell_family(table, found, data)
  }
}

out <- as.data.frame(do.call(rbind, lapply(told$rows, function(one) c(one[[1]], one[[2]], one[[3]], format(as.numeric(one[[4]]), digits = 12)))))
names(out) <- c("table", "row", "column", "value")
write.csv(out, arguments[3], row.names = FALSE, fileEncoding = "UTF-8")
