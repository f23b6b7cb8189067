/** Every script that a page is given, and the length of lines in their tests (make lint). */

import js from "@eslint/js";
import globals from "globals";

const DELIVERED = ["static/js/**"];

/** Folders of static/js, the lowest first: each imports from those before it alone. */
const FOLDERS = [
  ...["lib", "protocol", "input", "display", "video", "map", "study", "autonomy", "hud"],
  ...[
    "overlay",
    "technical",
    "check",
    "audience",
    "presence",
    "waiting",
    "drive",
    "pages(?!/check)",
  ],
];

/** @param {string} folder @param {number} place */
const downwardImports = (folder, place) => ({
  files: [`static/js/{,*/}${folder}/**`],
  rules: {
    "no-restricted-imports": [
      "error",
      {
        patterns: [
          {
            regex: `(^|/)(${FOLDERS.slice(place + 1).join("|")})/`,
            message: "Import downwards only: see FOLDERS in eslint.config.js.",
          },
        ],
      },
    ],
  },
});

export default [
  {
    ignores: [
      ...["**/*", "!static/", "!static/js/", "!static/js/**"],
      ...["!tests/", "!tests/js/", "!tests/js/**"],
    ],
  },
  { linterOptions: { reportUnusedDisableDirectives: "error" } },
  // Prettier, which breaks lines, leaves comments and texts as they are.
  { languageOptions: { ecmaVersion: 2022 }, rules: { "max-len": ["error", { code: 100 }] } },
  { files: DELIVERED, ...js.configs.recommended },
  {
    files: DELIVERED,
    languageOptions: { sourceType: "module", globals: globals.browser },
    rules: {
      // Of the same scope alone: a function may name what stands below it, as it is called later.
      "no-use-before-define": ["error", { functions: false, classes: false, variables: false }],
      "array-callback-return": "error",
      "max-lines-per-function": ["error", { max: 60, skipBlankLines: true, skipComments: true }],
      eqeqeq: ["error", "always", { null: "ignore" }],
      "no-constructor-return": "error",
      "no-duplicate-imports": "error",
      "no-eval": "error",
      "no-implied-eval": "error",
      "no-self-compare": "error",
      "no-shadow-restricted-names": "error",
      "no-template-curly-in-string": "error",
      "no-throw-literal": "error",
      "no-undef-init": "error",
      "no-unmodified-loop-condition": "error",
      "no-unreachable-loop": "error",
      "no-useless-assignment": "error",
      "no-var": "error",
      "prefer-const": "error",
    },
  },
  ...FOLDERS.slice(0, -1).map(downwardImports),
  { files: ["static/js/drive/load_retry.js"], languageOptions: { sourceType: "script" } },
];
