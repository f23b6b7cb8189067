/**
 * The sentences of the page, in the visitor's language, from sessions/_words.html: an element for
 * each key, with `{name}` to be filled in. A key may have the forms `.one` and `.other` for counts.
 */

/**
 * @param {Map<string, string>} sentences
 * @param {string} language a BCP 47 tag
 * @param {Record<string, string>} [always] values that every sentence may have
 */
export const createWords = (sentences, language, always = {}) => {
  const plurals = new Intl.PluralRules(language);

  /** @param {string} key @param {Record<string, string | number>} values */
  const say = (key, values = {}) => {
    const counted = "n" in values ? `${key}.${plurals.select(Number(values.n))}` : key;
    const sentence =
      sentences.get(counted) ?? sentences.get(`${key}.other`) ?? sentences.get(key) ?? "";
    return sentence.replace(/\{(\w+)\}/g, (whole, name) =>
      String(values[name] ?? always[name] ?? whole),
    );
  };

  /** The name of a person on this page. @param {any} name as it was sent: accounts/models.py */
  const nameOf = (name) => sentences.get(`name.${name}`) ?? name;

  return { say, nameOf, has: (/** @type {string} */ key) => sentences.has(key) };
};

/** @typedef {ReturnType<typeof createWords>} Words */

/**
 * @param {HTMLTemplateElement} template @param {string} language
 * @param {Record<string, string>} [always]
 */
export const readWords = (template, language, always) => {
  const elements = template.content.querySelectorAll("[data-word]");
  const sentences = Array.from(elements, (element) => [
    element.getAttribute("data-word") ?? "",
    (element.textContent ?? "").trim(),
  ]);
  return createWords(new Map(/** @type {[string, string][]} */ (sentences)), language, always);
};
