/**
 * The display's key: it stands behind the `#` of the address that the owner opens here once, and
 * becomes a cookie that no script reads.
 */

/**
 * @param {object} config of the page
 * @param {string} config.key where the key is exchanged
 * @param {string} config.csrf
 * @returns {Promise<boolean>} false when there was a key and it was refused
 */
export const exchangeKey = async ({ key, csrf }) => {
  const given = location.hash.slice(1);
  if (!given) {
    return true;
  }
  const body = new URLSearchParams({ key: given });
  const answer = await fetch(key, {
    method: "POST",
    body,
    headers: { "X-CSRFToken": csrf },
    credentials: "same-origin",
  });
  if (answer.ok) {
    // It must not stay in the history of a display that anybody may touch.
    history.replaceState(null, "", location.pathname);
  }
  return answer.ok;
};
