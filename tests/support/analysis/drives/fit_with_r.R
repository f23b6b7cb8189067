# Fits models of proportions, counts and times to drives.csv, for
# tests/unit/experiments/analysis/statistics/test_regression.py. Writes fits.csv beside itself: of each
# model the coefficients with their robust standard errors, and the log-rank test.
#   logistic, poisson   glm with CR3 of clubSandwich, which is the correction of Mancl and DeRouen
#   cox                 coxph of survival (Breslow's ties) with participants as clusters
# Run with: Rscript fit_with_r.R (Debian: r-base-core r-cran-survival r-cran-clubsandwich)

suppressPackageStartupMessages({library(survival); library(clubSandwich)})
here <- dirname(sub("^--file=", "", grep("^--file=", commandArgs(FALSE), value = TRUE)))
drives <- read.csv(file.path(here, "drives.csv"))
for (key in c("delay", "help")) {
  drives[[key]] <- factor(drives[[key]], levels = list(delay = c("none", "long"), help = c("alone", "helped"))[[key]])
  contrasts(drives[[key]]) <- contr.sum(2)
}
right <- "delay + help + delay:help"
found <- list()
tell <- function(model, names, estimates, errors)
  found[[length(found) + 1]] <<- data.frame(model = model, coefficient = names, estimate = estimates, error = errors)
robust <- function(model, formula, family) {
  fit <- glm(as.formula(paste(formula, "~", right)), family, drives, epsilon = 1e-12,
    offset = if (model == "poisson") log(drives$minutes) else NULL)
  tell(model, names(coef(fit)), coef(fit), sqrt(diag(vcovCR(fit, cluster = drives$who, type = "CR3"))))
}
robust("logistic", "completed", binomial())
robust("poisson", "stops", poisson())
cox <- coxph(as.formula(paste("Surv(seconds, came) ~", right, "+ cluster(who)")), drives, ties = "breslow",
  control = coxph.control(eps = 1e-12, iter.max = 100))
tell("cox", names(coef(cox)), coef(cox), sqrt(diag(vcov(cox))))
rank <- survdiff(Surv(seconds, came) ~ delay, subset(drives, help == "alone"))
tell("log-rank", "delay", rank$chisq, NA)
median_of <- summary(survfit(Surv(seconds, came) ~ 1, drives))$table[["median"]]
tell("median", "all", median_of, NA)
# robust score tests of each term: residuals without it, times what of its column the others do not
# explain, summed for each participant; Hotelling's T2 of one column is the square of t
columns <- model.matrix(as.formula(paste("~", right)), drives)
tell_score <- function(model, term, scores) {
  t <- t.test(rowsum(scores, drives$who))
  tell(paste0("score-", model), term, t$statistic^2, t$p.value)
}
for (term in c("delay1", "help1", "delay1:help1")) {
  own <- columns[, term]; rest <- columns[, colnames(columns) != term]
  for (model in c("logistic", "poisson")) {
    fit <- if (model == "logistic") glm(drives$completed ~ rest - 1, binomial(), epsilon = 1e-12)
      else glm(drives$stops ~ rest - 1, poisson(), offset = log(drives$minutes), epsilon = 1e-12)
    mean <- fitted(fit); weights <- if (model == "logistic") mean * (1 - mean) else mean
    left <- residuals(lm(own ~ rest - 1, weights = weights))
    tell_score(model, term, left * (drives[[c(logistic = "completed", poisson = "stops")[[model]]]] - mean))
  }
  rest <- rest[, -1]
  null <- coxph(Surv(seconds, came) ~ rest, drives, ties = "breslow", control = coxph.control(eps = 1e-12, toler.inf = 1e-9, iter.max = 100))
  start <- setNames(numeric(3), colnames(columns)[-1]); start[colnames(columns)[-1] != term] <- coef(null)
  at <- coxph(Surv(seconds, came) ~ columns[, -1], drives, ties = "breslow", init = start, control = coxph.control(iter.max = 0))
  scores <- residuals(at, "score"); information <- solve(at$var); place <- which(names(start) == term)
  tell_score("cox", term, scores[, place] - scores[, -place] %*% solve(information[-place, -place], information[-place, place]))
}
options(digits = 15)
write.csv(do.call(rbind, found), file.path(here, "fits.csv"), row.names = FALSE, quote = FALSE, na = "")
