/** Browsers inside other apps, which open links in messages. Many of them have no live video. */

/** Their names in the user agent, and the names of the apps. */
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

/** The browser of such a device. @param {string} userAgent @returns {"Safari" | "Chrome"} */
export const browserFor = (userAgent) =>
  /\b(?:iPhone|iPad|iPod)\b/.test(userAgent) ? "Safari" : "Chrome";
