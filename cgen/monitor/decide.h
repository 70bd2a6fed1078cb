/* SPDX-License-Identifier: MIT-0 */
/*
 * decide.h -- an exported monitor in control: whose decision is taken, and the verdicts on the way.
 *
 * A monitor holds a copy with its own names for MODEL, after its header and its check of controllers.
 */
#ifndef DL2C_MONITOR_DECIDE_H
#define DL2C_MONITOR_DECIDE_H

MODEL_decision MODEL_decide(MODEL_state curr, const MODEL_parameters *params,
                            const MODEL_input *input, MODEL_ctrl *ctrl, MODEL_ctrl *fallback)
{
  MODEL_decision made;
  made.post = curr;
  made.verdict = MODEL_check_controller(&curr, &made.post, params);
  if (ctrl != 0) {
    made.post = ctrl(curr, params, input);
    made.verdict = MODEL_check_controller(&curr, &made.post, params);
  }
  made.wanted = made.verdict;
  made.overruled = ctrl == 0 || made.verdict.id != 0;
  if (!made.overruled)
    return made;
  if (fallback != 0) {
    made.post = fallback(curr, params, input);
    made.verdict = MODEL_check_controller(&curr, &made.post, params);
    if (made.verdict.id == 0)
      return made;
  }
  const MODEL_state post = MODEL_fallback(curr, params, input);
  const MODEL_verdict verdict = MODEL_check_controller(&curr, &post, params);
  if (fallback == 0 || verdict.id == 0) {
    made.post = post;
    made.verdict = verdict;
  }
  return made;
}

#endif
