/**
 * Browsers inside other apps, which open links that somebody sent. Many of them carry no live
 * video, and the way out is a menu of theirs.
 */

/** What their names look like in the user agent, and the app that visitors know them by. */
const APPS = /** @type {[RegExp, string][]} */ ([
  [/\bInstagram\b/, "Instagram"],
  [/\bFB(?:AN|AV|_IAB)\b/, "Facebook"],
  [/\bMicroMessenger\b/, "WeChat"],
  [/\bLine\//, "LINE"],
  [/\b(?:musical_ly|BytedanceWebview|TikTok)\b/, "TikTok"],
  [/\bSnapchat\b/, "Snapchat"],
  [/\bLinkedInApp\b/, "LinkedIn"],
  [/\bTwitter\b/, "X"],
  [/\bPinterest\b/, "Pinterest"],
  [/\bKAKAOTALK\b/, "KakaoTalk"],
  [/\bGSA\//, "Google"],
  [/; wv\)/, "app"],
]);

/**
 * @param {string} userAgent
 * @returns {string} the app whose browser this is, "app" for one without a name, empty for a
 *   browser proper
 */
export const appOf = (userAgent) => APPS.find(([name]) => name.test(userAgent))?.[1] ?? "";

/**
 * The browser that such a device surely has.
 * @param {string} userAgent @returns {"Safari" | "Chrome"}
 */
export const browserFor = (userAgent) =>
  /\b(?:iPhone|iPad|iPod)\b/.test(userAgent) ? "Safari" : "Chrome";
