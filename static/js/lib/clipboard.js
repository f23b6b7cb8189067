/**
 * Copies a text, also in browsers of apps, which often lack the Clipboard API.
 * @param {string} text
 * @returns {Promise<boolean>} whether it was copied
 */
export const copy = async (text) => {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    return copyByHand(text); // no clipboard here, or not for this page
  }
};

/** @param {string} text */
const copyByHand = (text) => {
  const field = document.createElement("textarea");
  field.value = text;
  field.readOnly = true;
  field.className = "visually-hidden";
  document.body.append(field);
  field.select();
  const done = document.execCommand("copy");
  field.remove();
  return done;
};
