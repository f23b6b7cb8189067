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
options(digits = 15)
write.csv(do.call(rbind, found), file.path(here, "fits.csv"), row.names = FALSE, quote = FALSE, na = "")
