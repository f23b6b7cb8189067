/**
 * The sentences of a page, in the visitor's language: the template #words has an element for each
 * key, with `{name}` to be filled in. A key may have the forms `.one` and `.other` for counts.
 */

import { element } from "./dom.js";

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

/** The words of this page. @param {Record<string, string>} [always] */
export const readWords = (always) => {
  /** @type {NodeListOf<HTMLElement>} */
  const elements = element("words").content.querySelectorAll("[data-word]");
  const sentences = Array.from(elements, ({ dataset, textContent }) => {
    return /** @type {[string, string]} */ ([dataset.word, textContent?.trim()]);
  });
  return createWords(new Map(sentences), document.documentElement.lang, always);
};
