/** A line of a conversation, for the list of messages on either side. */

/** @param {{who: string, text: string, own: boolean}} line @returns {HTMLLIElement} */
export const lineOf = ({ who, text, own }) => {
  const line = document.createElement("li");
  line.className = own ? "line line--own" : "line";
  const name = document.createElement("span");
  name.className = "line__who";
  name.textContent = who;
  const words = document.createElement("span");
  words.className = "line__text";
  words.textContent = text;
  line.append(name, " ", words);
  return line;
};
