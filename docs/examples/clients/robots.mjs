// Lists the robots of a site, or stops one or sends it to its station, over the JSON API.
//
// node robots.mjs URL                          one line for each robot
// node robots.mjs URL ROBOT stop|estop|dock    with the robot's key in the variable ROBOT_KEY

/** The JSON API of a site; `key` belongs to one robot, and may act on it. */
class Site {
  constructor(url, key = "") {
    this.url = url.replace(/\/$/, "");
    this.key = key;
  }

  async robots() {
    return (await this.#answer("robots/")).robots;
  }

  /** Send a robot a command; its state shows what becomes of it. */
  act(robot, action) {
    return this.#answer(`robots/${robot}/actions/`, { type: action });
  }

  async #answer(path, content) {
    const headers = { "Content-Type": "application/json" };
    if (this.key) headers.Authorization = `Bearer ${this.key}`;
    const options = content ? { method: "POST", body: JSON.stringify(content) } : {};
    const answer = await fetch(`${this.url}/api/v1/${path}`, { headers, ...options });
    const found = await answer.json();
    if (!answer.ok) throw new Error(`refused: ${found.detail}`);
    return found;
  }
}

function lineOf({ name, state, charge, docked }) {
  const percent = charge === null ? "" : `${Math.round(100 * charge)} %`;
  const words = `${name.padEnd(15)} ${state.padEnd(10)} ${percent.padStart(5)}  ${docked ? "docked" : ""}`;
  return words.trimEnd();
}

const [url, robot, action] = process.argv.slice(2);
const site = new Site(url, process.env.ROBOT_KEY);
try {
  if (robot) await site.act(robot, action);
  else console.log((await site.robots()).map(lineOf).join("\n"));
} catch (error) {
  console.error(error.message);
  process.exitCode = 1;
}
