/**
 * Calls a visitor who looks elsewhere: two short tones, vibration, and a notification where the
 * visitor has allowed them. Loaded only while the visitor waits, or is asked whether they are still
 * there. A browser lets a page play sounds only after a touch, so `prepare` is called on each.
 */

const TONES = [
  { at: 0, hertz: 660 },
  { at: 0.18, hertz: 880 },
];
const TONE_SECONDS = 0.16;
const LOUDNESS = 0.2;

/** @type {AudioContext | null} */
let audio = null;

/** Prepares the sound; within a touch, when browsers allow it. */
export const prepare = () => {
  if (typeof AudioContext === "function") {
    audio ??= new AudioContext();
    void audio.resume();
  }
};

/** "default" while the visitor can still be asked. @returns {NotificationPermission} */
export const permission = () =>
  typeof Notification === "function" ? Notification.permission : "denied";

/** Within a click. @returns {Promise<NotificationPermission>} */
export const askPermission = async () => {
  prepare();
  return typeof Notification === "function" ? Notification.requestPermission() : "denied";
};

const sound = () => {
  if (audio?.state !== "running") {
    return;
  }
  for (const { at, hertz } of TONES) {
    const begin = audio.currentTime + at;
    const tone = new OscillatorNode(audio, { frequency: hertz });
    const gain = new GainNode(audio, { gain: 0 });
    gain.gain.linearRampToValueAtTime(LOUDNESS, begin + 0.02);
    gain.gain.linearRampToValueAtTime(0, begin + TONE_SECONDS);
    tone.connect(gain).connect(audio.destination);
    tone.start(begin);
    tone.stop(begin + TONE_SECONDS);
  }
};

/** @param {string} title @param {string} body */
const notify = async (title, body) => {
  const options = {
    body,
    tag: "turn",
    renotify: true,
    icon: /** @type {HTMLLinkElement | null} */ (document.querySelector("link[rel=icon]"))?.href,
  };
  const worker = await navigator.serviceWorker?.getRegistration();
  if (worker?.active) {
    await worker.showNotification(title, options);
    return;
  }
  const note = new Notification(title, options);
  note.onclick = () => {
    window.focus();
    note.close();
  };
};

/**
 * @param {string} title @param {string} body of the notification, while the page is in the
 * background
 */
export const call = async (title, body) => {
  sound();
  navigator.vibrate?.([200, 100, 200]);
  if (permission() === "granted" && (document.hidden || !document.hasFocus())) {
    try {
      await notify(title, body);
    } catch (error) {
      // Phones show notifications of service workers only, and there is none here.
      if (!(error instanceof TypeError)) {
        throw error;
      }
    }
  }
};
