/**
 * The display's key, behind the `#` of the address that the owner opens here once, becomes a cookie
 * that no script reads.
 * @param {{key: string, csrf: string}} config `key`: the address that exchanges it
 * @returns {Promise<boolean>} false when there was a key and it was refused
 */
export const exchangeKey = async ({ key, csrf }) => {
  const given = location.hash.slice(1);
  if (!given) {
    return true;
  }
  const body = new URLSearchParams({ key: given });
  const answer = await fetch(key, { method: "POST", body, headers: { "X-CSRFToken": csrf } });
  if (answer.ok) {
    history.replaceState(null, "", location.pathname); // everyone can touch the display
  }
  return answer.ok;
};
