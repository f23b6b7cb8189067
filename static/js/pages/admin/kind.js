/** Forms about a robot's kind: shows only the fields that the chosen software and model need. */

const OTHER = "other"; // robots/forms.py

for (const pair of document.querySelectorAll("[data-select-or-other]")) {
  const [select, text] = /** @type {NodeListOf<HTMLSelectElement | HTMLInputElement>} */ (
    pair.querySelectorAll("select, input")
  );
  const show = () => {
    text.hidden = select.value !== OTHER;
  };
  select.addEventListener("change", show);
  show();
}

for (const form of /** @type {NodeListOf<HTMLFormElement>} */ (
  document.querySelectorAll("[data-kind]")
)) {
  const adapter = /** @type {HTMLSelectElement} */ (form.querySelector("select[name=adapter]"));
  const options = /** @type {NodeListOf<HTMLElement>} */ (form.querySelectorAll("[data-adapter]"));
  const show = () => {
    for (const option of options) {
      const field = /** @type {HTMLElement} */ (option.parentElement);
      field.hidden = option.dataset.adapter !== adapter.value;
    }
  };
  adapter.addEventListener("change", show);
  show();
}
