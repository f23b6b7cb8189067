# Fits a random intercept by REML with lme4 to data that come with R, for
# tests/unit/experiments/analysis/statistics/test_lme4_agreement.py. Writes, beside itself,
#   data/<name>.csv   outcome, group, and the predictors of the model
#   models.csv        a row a data set: where it comes from, the terms and their coding
#   fits.csv          a row a coefficient, and the two standard deviations
#   robust.csv        what clubSandwich says by CR2 of each coefficient (standard error, degrees of
#                     freedom of Satterthwaite) and of each term (F of "HTZ", df of its denominator;
#                     empty where there are too few groups)
# Run with: Rscript fit_with_lme4.R
# (Debian: r-base-core r-cran-lme4 r-cran-nlme r-cran-mass r-cran-clubsandwich)

suppressPackageStartupMessages({
  library(nlme)
  library(lme4)
  library(clubSandwich)
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
robust <- list()
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
  covariance <- vcovCR(fit, cluster = own$who, type = "CR2")
  tests <- coef_test(fit, vcov = covariance, test = "Satterthwaite")
  robust[[one$name]] <- data.frame(name = one$name, what = "coefficient", of = rownames(table),
    error = tests$SE, df = tests[[grep("^df", names(tests))[1]]])
  assigned <- attr(model.matrix(fit), "assign")
  for (term in seq_len(max(assigned, 0))) {
    found <- tryCatch(Wald_test(fit, constraints = constrain_zero(which(assigned == term)),
      vcov = covariance, test = "HTZ"), error = function(e) NULL)
    is_there <- !is.null(found) && isTRUE(found$df_denom > 0)
    robust[[one$name]] <- rbind(robust[[one$name]], data.frame(name = one$name, what = "term",
      of = strsplit(one$terms, " ")[[1]][term], error = if (is_there) found$Fstat else NA,
      df = if (is_there) found$df_denom else NA))
  }
  told[[one$name]] <- data.frame(
    name = one$name, package = one$package, factors = paste(one$factors, collapse = " "),
    numbers = paste(one$numbers, collapse = " "), terms = one$terms, coding = one$coding,
    R = paste(R.version$major, R.version$minor, sep = "."), lme4 = as.character(packageVersion("lme4")),
    nlme = as.character(packageVersion("nlme")),
    clubSandwich = as.character(packageVersion("clubSandwich"))
  )
  write.csv(own, file.path(here, "data", paste0(one$name, ".csv")), row.names = FALSE, quote = FALSE)
}
options(digits = 15)
write.csv(do.call(rbind, told), file.path(here, "models.csv"), row.names = FALSE, quote = FALSE)
write.csv(do.call(rbind, fits), file.path(here, "fits.csv"), row.names = FALSE, quote = FALSE, na = "")
write.csv(do.call(rbind, robust), file.path(here, "robust.csv"), row.names = FALSE, quote = FALSE, na = "")
