/**
 * s after which a link that is lost may need new credentials for the relay; half of their life, as
 * on the robot's side (robots/ice.py).
 */
const ICE_SECONDS = 3 * 3600;

/**
 * Whether a relay may no longer take the credentials of these servers. Pure.
 * @param {{iceServers: RTCIceServer[], iceAt: number}} received with the Unix time when they came
 * @param {number} now Unix time
 */
export const areCredentialsOld = ({ iceServers, iceAt }, now) =>
  now - iceAt > ICE_SECONDS && iceServers.some(({ credential }) => credential);
