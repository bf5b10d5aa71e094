-- every run, of the main matrix and of the studies beside it: what it is, how it went, the hash of what makes it again
SELECT run, name, task, scheme, misalignment_kind, misalignment_deg, seed, status, estimator,
       episodes, final_return, final_success_rate,
       config->>'$.policy.buffer' AS buffer, config->>'$.policy.reset' AS reset,
       (config->>'$.policy.reset_updates')::INT AS reset_updates, config->>'$.world.robot' AS robot,
       (config->>'$.world.cube_half_range')::DOUBLE AS cube_half_range,
       (config->>'$.policy.episodes')::INT AS training_episodes,
       (config->>'$.policy.td3.gamma')::DOUBLE AS gamma,
       (config->>'$.policy.td3.exploration_noise')::DOUBLE AS exploration_noise,
       (config->>'$.policy.td3.preactivation_penalty')::DOUBLE AS preactivation_penalty,
       (config->>'$.policy.td3.exploration_correlation')::DOUBLE AS exploration_correlation,
       config->>'$.policy.proprioception' AS proprioception,
       config->>'$.policy.observation_scale' AS observation_scale, config_sha256,
       name IN ('laptop') AS main, config
FROM runs
WHERE name IN ('laptop')
ORDER BY run
