# Fits a random intercept by REML with lme4 to data that come with R, for
# tests/unit/experiments/analysis/statistics/test_lme4_agreement.py. Writes, beside itself,
#   data/<name>.csv   outcome, group, and the predictors of the model
#   models.csv        a row a data set: where it comes from, the terms and their coding
#   fits.csv          a row a coefficient, and the two standard deviations
#   freedom.csv       the denominator degrees of freedom that nlme's lme gives the coefficients (its
#                     summary) and the terms (its anova)
# Run with: Rscript fit_with_lme4.R (Debian: r-base-core r-cran-lme4 r-cran-nlme r-cran-mass)

suppressPackageStartupMessages({
  library(nlme)
  library(lme4)
})
here <- dirname(sub("^--file=", "", grep("^--file=", commandArgs(FALSE), value = TRUE)))
data_of <- function(package, name) {
  if (package == "nlme") return(as.data.frame(getExportedValue(package, name)))
  found <- new.env()
  data(list = name, package = package, envir = found)
  as.data.frame(found[[name]])
}

# name, package, outcome, group (columns that make it together), factors, numbers, terms, coding
models <- list(
  list("sleepstudy", "lme4", "Reaction", "Subject", c(), "Days", "Days", "treatment"),
  list("Dyestuff", "lme4", "Yield", "Batch", c(), c(), "", "treatment"),
  list("Dyestuff2", "lme4", "Yield", "Batch", c(), c(), "", "treatment"),
  list("Pastes", "lme4", "strength", c("batch", "cask"), c(), c(), "", "treatment"),
  list("Penicillin", "lme4", "diameter", "plate", "sample", c(), "sample", "sum"),
  list("cake", "lme4", "angle", c("recipe", "replicate"), c("recipe", "temperature"), c(),
       "recipe temperature recipe:temperature", "sum"),
  list("Rail", "nlme", "travel", "Rail", c(), c(), "", "treatment"),
  list("ergoStool", "nlme", "effort", "Subject", "Type", c(), "Type", "treatment"),
  list("Machines", "nlme", "score", "Worker", "Machine", c(), "Machine", "sum"),
  list("Orthodont", "nlme", "distance", "Subject", "Sex", "age", "age Sex age:Sex", "treatment"),
  list("Oxide", "nlme", "Thickness", "Lot", "Source", c(), "Source", "treatment"),
  list("Oats", "nlme", "yield", "Block", c("Variety", "nitro"), c(),
       "Variety nitro Variety:nitro", "treatment"),
  list("BodyWeight", "nlme", "weight", "Rat", "Diet", "Time", "Time Diet Time:Diet", "treatment"),
  list("Pixel", "nlme", "pixel", "Dog", "Side", c(), "Side", "treatment"),
  list("RatPupWeight", "nlme", "weight", "Litter", c("sex", "Treatment"), "Lsize",
       "sex Treatment Lsize sex:Treatment", "treatment"),
  list("Alfalfa", "nlme", "Yield", "Block", c("Variety", "Date"), c(),
       "Variety Date Variety:Date", "sum"),
  list("petrol", "MASS", "Y", "No", c(), c("SG", "VP", "V10", "EP"), "SG VP V10 EP", "treatment"),
  list("ChickWeight", "datasets", "weight", "Chick", "Diet", "Time", "Time Diet", "treatment"),
  list("CO2", "datasets", "uptake", "Plant", c("Type", "Treatment"), "conc",
       "conc Type Treatment Type:Treatment", "sum"),
  list("sleep", "datasets", "extra", "ID", "group", c(), "group", "treatment"),
  # pairs: more degrees of freedom between groups than within
  list("Meat", "nlme", "score", "Pair", "Storage", c(), "Storage", "treatment")
)

told <- list()
fits <- list()
freedom <- list()
for (one in models) {
  names(one) <- c("name", "package", "outcome", "group", "factors", "numbers", "terms", "coding")
  raw <- data_of(one$package, one$name)
  own <- data.frame(outcome = raw[[one$outcome]])
  own$who <- do.call(paste, c(lapply(raw[one$group], as.character), sep = "."))
  # levels are sorted as text, as the test sorts them
  for (key in one$factors) {
    own[[key]] <- factor(as.character(raw[[key]]), levels = sort(unique(as.character(raw[[key]])), method = "radix"))
    contrasts(own[[key]]) <- if (one$coding == "sum") contr.sum(nlevels(own[[key]])) else
      contr.treatment(nlevels(own[[key]]))
  }
  for (key in one$numbers) own[[key]] <- as.numeric(raw[[key]])
  right <- if (one$terms == "") "1" else gsub(" ", " + ", one$terms)
  # our columns stand in the order of the terms, and so they do in the formula
  formula <- terms(as.formula(paste("outcome ~", right, "+ (1 | who)")), keep.order = TRUE)
  fit <- suppressMessages(lmer(formula(formula), own, REML = TRUE,
    control = lmerControl(optimizer = "bobyqa", optCtrl = list(rhoend = 1e-10))))
  table <- coef(summary(fit))
  spread <- as.data.frame(VarCorr(fit))$sdcor
  fits[[one$name]] <- data.frame(
    name = one$name,
    coefficient = c(rownames(table), "SD participants", "SD residual"),
    estimate = c(table[, "Estimate"], spread),
    error = c(table[, "Std. Error"], NA, NA)
  )
  # of fixed effects, groups and counts alone: no matter where the search for variances ends
  df <- lme(formula(terms(as.formula(paste("outcome ~", right)), keep.order = TRUE)), own,
    random = ~ 1 | who, control = lmeControl(opt = "optim", returnObject = TRUE))$fixDF
  freedom[[one$name]] <- data.frame(
    name = one$name, what = rep(c("coefficient", "term"), c(length(df$X), length(df$terms))),
    of = c(names(df$X), names(df$terms)), df = c(df$X, df$terms)
  )
  told[[one$name]] <- data.frame(
    name = one$name, package = one$package, factors = paste(one$factors, collapse = " "),
    numbers = paste(one$numbers, collapse = " "), terms = one$terms, coding = one$coding,
    R = paste(R.version$major, R.version$minor, sep = "."), lme4 = as.character(packageVersion("lme4")),
    nlme = as.character(packageVersion("nlme"))
  )
  write.csv(own, file.path(here, "data", paste0(one$name, ".csv")), row.names = FALSE, quote = FALSE)
}
options(digits = 15)
write.csv(do.call(rbind, told), file.path(here, "models.csv"), row.names = FALSE, quote = FALSE)
write.csv(do.call(rbind, fits), file.path(here, "fits.csv"), row.names = FALSE, quote = FALSE, na = "")
write.csv(do.call(rbind, freedom), file.path(here, "freedom.csv"), row.names = FALSE, quote = FALSE)
