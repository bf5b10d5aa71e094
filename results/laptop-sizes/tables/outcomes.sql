-- where each run ended: its final evaluation, or the last one made while training
SELECT run, name, task, misalignment_kind, misalignment_deg, scheme, seed, split, after_episode, episodes,
       mean_return, success_rate, mean_steps_to_success, mean_estimation_error
FROM outcomes()
WHERE run IN (SELECT run FROM runs WHERE status <> 'failed' AND name IN ('laptop'))
ORDER BY run
