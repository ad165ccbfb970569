// Talking to the server: every request carries the token of the run, which the page's address brought.

const token = location.hash.slice(1) || sessionStorage.getItem("token") || "";
if (token) sessionStorage.setItem("token", token);
addEventListener("hashchange", () => location.reload());

const headers = { Authorization: `Bearer ${token}` };

/** An answer that is an error: its text is for people. */
export class Refused extends Error {}

async function send(path, options = {}) {
  let answer;
  try {
    answer = await fetch(path, { ...options, headers: { ...headers, ...options.headers }, cache: "no-store" });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Refused("The studio does not answer. Is the program still running?");
  }
  if (!answer.ok) throw new Refused((await answer.text()) || `The studio answered ${answer.status}.`);
  return answer;
}

const query = (parameters) => new URLSearchParams(Object.entries(parameters).filter(([, value]) => value != null));

export async function ask(path, parameters = {}) {
  return (await send(`${path}?${query(parameters)}`)).json();
}

export async function tell(path, message) {
  const options = { method: "POST", body: JSON.stringify(message), headers: { "Content-Type": "application/json" } };
  return (await send(path, options)).json();
}

/** A picture, and the answer's headers. */
export async function picture(path, parameters = {}, signal) {
  const answer = await send(`${path}?${query(parameters)}`, { signal });
  return { bitmap: await createImageBitmap(await answer.blob()), headers: answer.headers };
}

/** Hands every new state to `on`; says by `linked` whether the server is there. Never ends. */
export async function listen(on, linked) {
  for (;;) {
    try {
      const answer = await send("/api/events");
      linked(true);
      const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
      let text = "";
      for (;;) {
        const { value, done } = await reader.read();
        if (done) break;
        text += value;
        const events = text.split("\n\n");
        text = events.pop();
        const data = events.filter((event) => event.startsWith("data:"));
        // Only the last state counts.
        if (data.length) on(JSON.parse(data.at(-1).slice(5)));
      }
      linked(false, "The studio has ended. Everything is saved: start it again and open the address it prints.");
    } catch (error) {
      linked(false, error instanceof Refused ? error.message : String(error));
    }
    await new Promise((wake) => setTimeout(wake, 1000));
  }
}
