// What is said to people: where a photo stands, and what to do next.

export const STATUS = {
  todo: "to do", picked: "has a pose", registered: "registered", uncertain: "uncertain", failed: "failed", accepted: "accepted",
};

const SOURCE = { file: "the file of cameras", pairs: "the pairs", hand: "your keys", registration: "the registration" };

export const count = (n, word) => `${n} ${word}${n === 1 ? "" : "s"}`;

/** What to do next with a photo, and how urgent that is: `["words", "" | "doubt" | "bad"]`. */
export function next(state, number, { nudging, opened }) {
  const photo = state.photos[number];
  const { pairs, pending, camera, status } = photo;
  const { job, queue } = state;
  if (job?.photo === number) {
    const at = job.of ? `step ${job.done} of ${job.of}` : "starting";
    return [`Registering, ${at}${queue.length ? `; ${queue.length} more to come` : ""}. Esc stops it.`, ""];
  }
  if (!opened) return ["Opening the photo…", ""];
  if (nudging) {
    return ["Move the model: arrows shift it, I K J L turn it, U O roll it, + − bring it nearer or farther; Shift for larger steps. M ends it.", ""];
  }
  if (pending?.uv) return ["Now click the same point on the model, at the right. Esc takes the first click back.", ""];
  if (pending?.xyz) return ["Now click the same point in the photo, at the left. Esc takes the first click back.", ""];
  if (photo.trouble) return [`${sentence(photo.trouble)} Check the pairs, or add one.`, "bad"];
  if (!camera) {
    const left = 4 - pairs.length;
    if (!pairs.length) {
      return ["Turn the model until it looks about like the photo (drag). Then click a point in the photo that you recognize on the model.", ""];
    }
    return [`Click another point in the photo: ${count(left, "pair")} more make${left === 1 ? "s" : ""} a pose. Spread them over the object.`, ""];
  }
  const doubted = pairs.findIndex((pair) => pair.suspicious);
  if (doubted >= 0 && camera.source === "pairs") {
    return [`Pair ${pairs[doubted].name || doubted + 1} does not go with the others: drag it to its place, or delete it (Del).`, "doubt"];
  }
  if (photo.ambiguous && camera.source === "pairs") {
    return ["Another pose explains the pairs about as well: add a pair away from the others, nearer or farther.", "doubt"];
  }
  if (status === "picked") {
    if (photo.optics === "unknown" && pairs.length < 6) {
      const left = 6 - pairs.length;
      return [`The photo does not say its focal length: ${count(left, "pair")} more tell it. Then register.`, "doubt"];
    }
    if (camera.source === "pairs" && pairs.length < 6) {
      return [`There is a pose. ${6 - pairs.length === 1 ? "One more pair makes" : "Two more pairs make"} it safer; then press Register (R).`, ""];
    }
    return [`The camera is from ${SOURCE[camera.source]}. Press Register (R) to lay the photo on the model exactly.`, ""];
  }
  if (status === "registered") {
    return ["Look: does the outline follow the object everywhere? Try Blend and Flicker (O). Accept it (A), or correct it with another pair.", ""];
  }
  if (status === "uncertain") {
    return ["The program is not sure. Look closely (O changes the view): accept it if it is right (A), else add a pair and register again.", "doubt"];
  }
  if (status === "failed") return ["No better camera was found. Add a pair or correct one, then register again (R).", "bad"];
  const open = state.photos.findIndex((other) => other.status !== "accepted");
  if (open >= 0) return [`Accepted. Go on with ${state.photos[open].file} (N).`, ""];
  return ["All photos are accepted. The cameras are in cameras.json; you can close this page.", ""];
}

/** The verdict in a sentence. */
export function verdict(photo) {
  const { camera } = photo;
  if (!camera) return "Not registered yet.";
  if (!camera.verdict) return `A camera from ${SOURCE[camera.source]}, not registered yet.`;
  const { start, end, sure } = camera.verdict;
  const off = sure == null ? "" : ` Sure to ±${sure.toFixed(2)} px.`;
  return `Agreement ${start.toFixed(3)} → ${end.toFixed(3)}.${off}`;
}

export const sentence = (words) => words.charAt(0).toUpperCase() + words.slice(1) + (/[.!?]$/.test(words) ? "" : ".");

/** The help sheet: a heading and its rows. */
export const SHEET = [
  ["Pick pairs", [
    ["click, click", "a point in one view, then the same in the other"],
    ["drag a cross", "move that end; the pose follows"],
    ["click a cross", "choose the pair"],
    ["Del", "take the chosen pair away"],
    ["Esc", "take the first click back"],
    ["Ctrl+Z, Ctrl+Y", "undo, redo"],
  ]],
  ["The photo", [
    ["drag, two fingers", "shift"],
    ["wheel, pinch", "zoom, down to single pixels"],
    ["F", "fit both views"],
  ]],
  ["The model", [
    ["drag", "turn"],
    ["Ctrl + drag", "roll"],
    ["Shift or right + drag", "shift"],
    ["wheel, pinch", "nearer, farther"],
    ["C", "see it as the photo's camera does"],
    ["V", "from the next side"],
    ["E, Q", "roll a quarter"],
    ["S", "next shading"],
  ]],
  ["Register and judge", [
    ["R, Shift+R", "register this photo, all photos with a pose"],
    ["Esc", "stop"],
    ["O", "model over photo: outline, blend, flicker, checkerboard, off"],
    ["A", "accept, or take that back"],
    ["B", "back to the pose of the pairs"],
    ["N, P", "next photo, previous photo"],
  ]],
  ["Move the camera by keys (M)", [
    ["arrows", "shift the model by a pixel"],
    ["I K J L", "turn it up, down, left, right"],
    ["U, O", "roll it"],
    ["+, −", "nearer, farther"],
    ["Shift", "ten times as far"],
    ["M, Esc", "done"],
  ]],
];
