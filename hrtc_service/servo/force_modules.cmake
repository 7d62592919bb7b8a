# The modules that the servo links. A change of any file of these modules, of the servo, or of the replay in hrtc_service,
# changes the build id of recordings. The list does not omit code without influence on forces, because nobody would notice
# a wrong omission.
set(force_modules spm haptics session sharing trace realtime)
set(replay_modules spm/codec hrtc_service)
