// What is said of an episode in sentences.

const ENDS = {
  blocked: "what was asked for has no run",
  deadlock: "no run is possible from here",
  numerical: "a value is undefined or too large",
  solver: "its motion is too stiff for this page; dl2c itself can follow it",
  stalled: "time stands still",
  diverged: "a loop of the program does not end",
  time_limit: "its steps are used up",
  end: "the run is complete",
};

// How an episode ended; `holding` says whether a predicate of a kind and name holds now.
export function endingOf(facts, moment, holding) {
  const reason = facts.reasons[moment.reason];
  const predicate = facts.predicates.find((p) => p.name === reason);
  const outcome = { none: "The episode is over", success: "Success", failure: "Failure" };
  const judged = () => `${reason} ${holding(predicate.category, reason) ? "holds" : "does not hold"}`;
  return `${outcome[facts.statuses[moment.status]]}: ${predicate ? judged() : (ENDS[reason] ?? reason)}`;
}

// The colour of that.
export function moodOf(facts, moment) {
  return { success: "good", failure: "bad" }[facts.statuses[moment.status]] ?? "";
}

// What to do first.
export function hintFor({ choices, inputs }) {
  const what = [...(choices.length > 0 ? ["an alternative"] : []), ...(inputs.length > 0 ? ["values"] : [])];
  const first = what.length > 0 ? `Choose ${what.join(" and ")}, then press` : "Press";
  return `${first} Run for real time, or Step for one decision.`;
}
